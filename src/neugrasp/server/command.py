"""`neugrasp serve` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Serve:
    """Answers photos with grasps over HTTP, for robots that share a machine (docs/server.md).

    Needs the extra `serve`: pip install 'neugrasp[serve]'.
    """

    doing: ClassVar[str] = "loading the weights, then listening until Ctrl-C"

    detector: str = "neugrasp"
    """One that takes photos: a name, or package.module:NAME (docs/benchmark.md)."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Score from which a grasp is one; by default the one that the weights were judged with."""
    hand_check: bool = True
    """Send grasps as deep as the surface lets the hand, and drop those that it speaks against."""
    evaluator: str = "neugrasp"
    """A bundled evaluator of grasps, or a file: what `--detector neugrasp-evaluator` asks."""
    devices: tuple[str, ...] = ("cpu",)
    """Where PyTorch computes, one worker on each: cpu, or cuda:0 cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Of its products."""
    host: str = "127.0.0.1"
    """Where to listen; any other address than this machine's own needs a token."""
    port: int = 8421
    """Where to listen; 0: any free one."""
    token_file: Path | None = None
    """A file with the token that clients must send (`Authorization: Bearer TOKEN`)."""
    queue: int = 8
    """Requests that are held at once, with those being answered; further ones get 429."""
    cells: int = 16
    """Cells that are kept; each holds its photos of the empty table and their features."""
    largest_mb: float = 64.0
    """Megabytes that the body of a request may have."""
    megapixels: float = 25.0
    """Of a photo, asked before it is decoded."""
    patience_s: float = 60.0
    """Seconds after which a request is given up: 408 while its body comes, 504 while it is answered."""
    grace_s: float = 30.0
    """Seconds that requests have to end after SIGTERM."""
    check: bool = False
    """Answer a bundled scene once over HTTP, say how long it took, and end."""
