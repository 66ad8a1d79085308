"""An evaluator of grasps on disk: safetensors, as the weights of the network that it goes with."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from torch import Tensor

from neugrasp.data.fields import shown
from neugrasp.errors import WeightsError, told_as
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.model.grasp_evaluator import BOX, GraspEvaluator
from neugrasp.model.weights_file import (
    check_tensors,
    described,
    named_file,
    read_weights,
    workspace_from,
    write_weights,
)

FORMAT = "neugrasp-evaluator"
WIDEST = 1024


@dataclass(frozen=True)
class EvaluatorFile:
    """What the file of an evaluator holds."""

    widths: tuple[int, int, int]
    hidden: int
    tensors: dict[str, Tensor]
    about: dict[str, Any]
    """Steps, commit, data: whatever the trainer noted."""
    workspace: Workspace = USUAL
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
    config = {"box": BOX, "widths": model.widths, "hidden": model.hidden}
    write_weights(path, FORMAT, model.state_dict(), config, workspace, about, half)


def shipped_evaluators() -> dict[str, Path]:
    """The evaluators that come with the package, by the name of the weights whose surfaces they know."""
    folder = Path(str(resources.files("neugrasp"))) / "weights" / "evaluators"
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


def find_evaluator(name_or_path: str | Path) -> Path:
    """The file of a shipped evaluator, by name, or of the user's own; raises `InputError` where none is."""
    return named_file(name_or_path, shipped_evaluators(), "evaluator", "ones")


@told_as(WeightsError)
def load_evaluator(name_or_path: str | Path) -> EvaluatorFile:
    """Reads an evaluator by name or from a file. Raises `WeightsError` on a missing, damaged, newer one."""
    path = find_evaluator(name_or_path)
    metadata, tensors = read_weights(path, FORMAT, "an evaluator of grasps")
    config = described(path, metadata, "config")
    config.only(("box", "widths", "hidden"))
    if tuple(config.list("box")) != BOX:
        raise config.refuse("box", f"is {shown(config.list('box'))}; this program reads boxes of {list(BOX)}")
    widths = config.list("widths")
    if len(widths) != 3 or not all(type(w) is int and 0 < w <= WIDEST for w in widths):
        raise config.refuse("widths", f"is {shown(widths)}; it must be three whole numbers of 1 to {WIDEST}")
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
    check_tensors(path, lambda: GraspEvaluator(found.widths, found.hidden), tensors)
    return found
