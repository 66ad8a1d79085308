"""An evaluator of grasps on disk: safetensors, as the weights of the network that it goes with."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path
from typing import Any

import torch
from safetensors.torch import save_file
from torch import Tensor

from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.checkpoint import CUBE, FLOATS, described, read_weights, workspace_from
from neugrasp.model.grasp_evaluator import BOX, GraspEvaluator
from neugrasp.output import whole_file

FORMAT, VERSION = "neugrasp-evaluator", 1
WIDEST = 1024


@dataclass(frozen=True)
class EvaluatorFile:
    """What the file of an evaluator holds."""

    widths: tuple[int, int, int]
    hidden: int
    tensors: dict[str, Tensor]
    about: dict[str, Any]
    """Steps, commit, data: whatever the trainer noted."""
    workspace: Workspace = field(default_factory=Workspace)
    """The cube whose grids it reads."""

    def model(self) -> GraspEvaluator:
        """The network with these weights, float32, ready to judge."""
        network = GraspEvaluator(self.widths, self.hidden)
        network.load_state_dict({name: tensor.float() for name, tensor in self.tensors.items()})
        return network.eval()


def save_evaluator(
    path: Path, model: GraspEvaluator, workspace: Workspace, about: dict[str, Any], half: bool = False
) -> None:
    """Writes the weights whole or not at all; `half` stores float16, for shipping."""
    tensors = {
        name: (tensor.half() if half else tensor.float()).detach().cpu().contiguous()
        for name, tensor in model.state_dict().items()
    }
    metadata = {
        "format": FORMAT,
        "version": str(VERSION),
        "config": json.dumps({"box": BOX, "widths": model.widths, "hidden": model.hidden}),
        "workspace": json.dumps(dict(zip(CUBE, workspace.cube, strict=True))),
        "about": json.dumps(about),
    }
    with whole_file(path) as part:
        save_file(tensors, part, metadata)


def shipped_evaluators() -> dict[str, Path]:
    """The evaluators that come with the package, by the name of the weights whose surfaces they know."""
    folder = Path(str(resources.files("neugrasp"))) / "weights" / "evaluators"
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


def find_evaluator(name_or_path: str | Path) -> Path:
    """The file of a shipped evaluator, by name, or of the user's own; raises `InputError` where none is."""
    shipped = shipped_evaluators()
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.is_file():
        raise InputError(
            f"no evaluator {str(name_or_path)!r}: neither a file nor one of the shipped ones "
            f"({', '.join(shipped) or 'none'})"
        )
    return path


def load_evaluator(name_or_path: str | Path) -> EvaluatorFile:
    """Reads an evaluator by name or from a file. Raises `InputError` on a missing, damaged or newer file."""
    path = find_evaluator(name_or_path)
    metadata, tensors = read_weights(path, FORMAT, "an evaluator of grasps")
    config = described(path, metadata, "config")
    config.only(("box", "widths", "hidden"))
    if tuple(config.list("box")) != BOX:
        raise config.refuse("box", f"is {config.list('box')}; this program reads boxes of {list(BOX)}")
    widths = config.list("widths")
    if len(widths) != 3 or not all(isinstance(w, int) and 0 < w <= WIDEST for w in widths):
        raise config.refuse("widths", f"is {widths}; it must be three whole numbers of 1 to {WIDEST}")
    about = described(path, metadata, "about")
    if "threshold" in about.data:
        about.number("threshold", 0, 1)
    found = EvaluatorFile(
        (widths[0], widths[1], widths[2]),
        config.whole("hidden", 1, WIDEST),
        tensors,
        about.data,
        workspace_from(path, metadata),
    )
    with torch.device("meta"):
        expected = GraspEvaluator(found.widths, found.hidden).state_dict()
    if wrong := set(expected) ^ set(tensors):
        raise InputError(f"{path}: tensors do not fit its configuration: {sorted(wrong)[:3]}")
    for name, tensor in tensors.items():
        if tensor.shape != expected[name].shape or tensor.dtype not in FLOATS:
            raise InputError(
                f"{path}: tensor {name} is {tensor.dtype} {tuple(tensor.shape)}; it does not fit"
            )
        if not torch.isfinite(tensor.float()).all():
            raise InputError(f"{path}: tensor {name} holds NaN or infinite values; the file is damaged")
    return found
