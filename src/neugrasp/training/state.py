"""The exact state of a run between two steps, so that a stopped run goes on as if it had not stopped."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, Protocol, TypeVar, cast

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn
from torch.optim.swa_utils import AveragedModel

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import parse_json
from neugrasp.errors import InputError
from neugrasp.output import whole_file
from neugrasp.training.config import Optimiser

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

STATE = "state.safetensors"
Tensors = tuple[Tensor, ...] | list[Tensor]
Net = TypeVar("Net", bound=nn.Module)


class Course(Protocol):
    """What a learner must know of a configuration."""

    @property
    def optimiser(self) -> Optimiser: ...


@dataclass(frozen=True)
class TrainState(Generic[Net]):
    """What a step changes."""

    model: Net
    average: AveragedModel
    """The moving average of the weights: what is validated and shipped."""
    optimizer: torch.optim.Adam

    @classmethod
    def of(cls, model: Net, config: Course) -> TrainState[Net]:
        """A learner at its start."""

        def averaged(averages: Tensors, now: Tensors, count: Tensor | int) -> None:
            # A young average forgets its random start sooner.
            decay = min(config.optimiser.average, (1 + int(count)) / (10 + int(count)))
            torch._foreach_lerp_(averages, now, 1 - decay)

        optimizer = torch.optim.Adam(model.parameters(), lr=config.optimiser.learning_rate)
        return cls(model, AveragedModel(model, multi_avg_fn=averaged), optimizer)

    def update(self, gradient_clip: float) -> None:
        """One step of the optimiser along the gradients, which are used up, and of the average."""
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), gradient_clip)
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        self.average.update_parameters(self.model)

    @property
    def smooth(self) -> Net:
        """The network with averaged weights."""
        return cast(Net, self.average.module)


@dataclass(frozen=True)
class Identity:
    """What a run that goes on must share with the one that stopped."""

    config: DataclassInstance
    data: str
    """A hash of the training data."""
    init: str | None = None
    """The weights that it began with."""

    def differences(self, saved: dict[str, Any]) -> list[str]:
        """Which of the saved facts are others now; how long a run is and how often it reports may change."""
        now, usual = self.facts(), _flat(asdict(type(self.config)()))
        # What a state does not know of was added later, and had its usual value before.
        return sorted(key for key in now if now[key] != saved.get(key, usual.get(key)))

    def facts(self) -> dict[str, Any]:
        """As plain data, nested names joined with dots."""
        facts = _flat(asdict(self.config)) | {"data": self.data, "init": self.init}
        return {key: value for key, value in facts.items() if key not in MAY_CHANGE}


MAY_CHANGE = ("steps", "checkpoint_every", "validate_every", "validation_scenes")


def _flat(data: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in data.items():
        if isinstance(value, dict):
            flat |= _flat(value, f"{prefix}{key}.")
        else:
            flat[prefix + key] = list(value) if isinstance(value, tuple) else value
    return flat


def save_state(folder: Path, learner: TrainState[Any], step: int, identity: Identity) -> None:
    """Writes weights, their average, Adam's moments and the number of finished steps, whole or not at all."""
    model, optimizer = learner.model, learner.optimizer
    names = {id(parameter): name for name, parameter in model.named_parameters()}
    tensors = {f"model.{name}": tensor for name, tensor in model.state_dict().items()}
    tensors |= {f"average.{name}": tensor for name, tensor in learner.average.state_dict().items()}
    for parameter, moments in optimizer.state.items():
        for key, value in moments.items():
            tensors[f"adam.{key}.{names[id(parameter)]}"] = torch.as_tensor(value)
    metadata = {"step": str(step), "identity": json.dumps(identity.facts(), sort_keys=True)}
    with whole_file(folder / STATE) as part:
        save_file(
            {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}, part, metadata
        )


@dataclass(frozen=True)
class State:
    """A run as it stopped, read once."""

    path: Path
    step: int
    """Finished steps."""
    facts: dict[str, Any]
    """What it was begun with, by the names of `Identity.facts`."""
    tensors: dict[str, Tensor]

    def steps_of_head(self, otherwise: int) -> int:
        """How long the head's stage was. Raises `InputError` where the file has no such number for it."""
        fields = Fields(str(self.path), self.facts, "identity.")
        return fields.whole("head_steps", 0, 10**9) if "head_steps" in self.facts else otherwise

    def restore(self, learner: TrainState[Any], identity: Identity) -> int:
        """Puts the state back and gives the number of finished steps.

        Raises `InputError` where it is damaged or belongs to another configuration or other data.
        """
        if differences := identity.differences(self.facts):
            raise InputError(
                f"{self.path}: belongs to a run with other values of {', '.join(differences)}; go on with "
                f"the same, or choose another --out (and --init {self.path.parent / 'weights.safetensors'} "
                "to start from its weights)"
            )
        try:
            learner.model.load_state_dict(_under(self.tensors, "model."))
            learner.average.load_state_dict(_under(self.tensors, "average."))
            for name, parameter in learner.model.named_parameters():
                if f"adam.step.{name}" in self.tensors:
                    learner.optimizer.state[parameter] = {
                        key: self._moment(key, name, parameter) for key in ("step", "exp_avg", "exp_avg_sq")
                    }
        except (RuntimeError, KeyError, ValueError) as error:
            raise InputError(f"{self.path}: damaged ({error}); remove it to start again") from error
        return self.step

    def _moment(self, key: str, name: str, parameter: Tensor) -> Tensor:
        """A moment of Adam where the optimiser wants it; of another shape it would fail at the first step."""
        value = self.tensors[f"adam.{key}.{name}"]
        if value.shape != (() if key == "step" else parameter.shape):
            raise ValueError(f"adam.{key}.{name} has shape {tuple(value.shape)}")
        return value.to("cpu" if key == "step" else parameter.device)


def read_state(folder: Path) -> State | None:
    """The state in `folder`; None where nothing was saved. Raises `InputError` where it cannot be read."""
    path = folder / STATE
    if not path.is_file():
        return None
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
        facts = Fields(str(path), parse_json(metadata["identity"], str(path)), "identity.").data
        return State(path, _count(metadata["step"]), facts, tensors)
    except InputError:
        raise
    except (SafetensorError, OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}: cannot be read ({error}); remove it to start again") from error


def _count(word: str) -> int:
    if not re.fullmatch("[0-9]{1,9}", word):
        raise ValueError(f"step is {word[:20]!r}")
    return int(word)


def _under(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name[len(prefix) :]: tensor for name, tensor in tensors.items() if name.startswith(prefix)}
