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

    detector: str = "auto"
    """A detector that takes photos, as in `neugrasp predict`."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Minimum score of a grasp; by default the one stored with the evaluator, or with the weights."""
    hand_check: bool = True
    """Without an evaluator: push each grasp as deep as the surface allows, and drop grasps that would
    collide or close on nothing."""
    evaluator: str = "neugrasp"
    """The evaluator that judges grasps: a bundled name, or a file."""
    devices: tuple[str, ...] = ("cpu",)
    """Devices of PyTorch, with one worker on each: cpu, or cuda:0 cuda:1."""
    precision: Literal["float32", "bfloat16"] = "float32"
    """Precision of its products."""
    host: str = "127.0.0.1"
    """Address to listen on; any other than this machine's own needs a token."""
    port: int = 8421
    """Port to listen on; 0 takes any free one."""
    token_file: Path | None = None
    """A file with the token that clients must send (`Authorization: Bearer TOKEN`)."""
    queue: int = 8
    """Maximum number of requests held at once, including those being answered; further ones get 429."""
    cells: int = 16
    """Maximum number of cells kept, each with its photos of the empty table and their features."""
    largest_mb: float = 64.0
    """Maximum size of a request's body, megabytes."""
    megapixels: float = 25.0
    """Maximum size of a photo, megapixels; checked before it is decoded."""
    patience_s: float = 60.0
    """Seconds after which a request is given up: 408 while its body comes, 504 while it is answered."""
    grace_s: float = 30.0
    """Seconds that requests have to finish after SIGTERM."""
    check: bool = False
    """Answer a bundled scene once over HTTP, say how long it took, and end."""
