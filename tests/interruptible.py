"""The two long commands on a small workload, for a child process that will be killed."""

from __future__ import annotations

import sys
from pathlib import Path


def generate_a_little(out: Path) -> None:
    """Three scenes of glassware with noise for photos."""
    sys.path.insert(0, str(Path(__file__).parent / "simulation"))
    from noise_renderer import SlowRenderer

    from neugrasp.simulation.command import Generate
    from neugrasp.simulation.generate import generate

    config = Generate(
        scene="packed",
        num=3,
        out=out,
        object_sets=("glassware",),
        grasp_points=2,
        scenes_per_cell=2,
        image_size=32,
        seed=4,
        workers=1,
    )
    generate(config, SlowRenderer)


def train_a_little(data: Path, held_out: Path, out: Path) -> None:
    """The recipe "tiny", started anew or gone on with."""
    import torch

    from neugrasp import cli

    torch.set_num_threads(1)
    arguments = ["train", "--recipe", "tiny", "--data", str(data), "--validation", str(held_out)]
    sys.exit(cli.main([*arguments, "--out", str(out), "--resume"]))
