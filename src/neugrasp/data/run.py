"""The command that packs scenes."""

from __future__ import annotations

from neugrasp.data.command import Pack
from neugrasp.data.packing import pack
from neugrasp.data.shards import Shards
from neugrasp.errors import InputError
from neugrasp.terminal import next_step


def run(config: Pack) -> str:
    """`neugrasp pack`: how many scenes are packed, and what to do next."""
    if config.quality is not None and not 1 <= config.quality <= 100:
        raise InputError(f"--quality {config.quality}; it must be 1 to 100")
    folders = [folder / "scenes" for folder in config.data]
    pack(folders, config.out, quality=config.quality, photos="all" if config.targets else "inputs")
    then = next_step("train", "--data", config.out, "--out", "runs/mine")
    return f"{len(Shards(config.out))} scenes in {config.out}\n{then}"
