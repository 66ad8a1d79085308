"""The exact state of a run between two steps, so that a stopped run goes on as if it had not stopped."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import cast

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor
from torch.optim.swa_utils import AveragedModel

from neugrasp.errors import InputError
from neugrasp.model.network import NeuGrasp
from neugrasp.training.config import TrainConfig

STATE = "state.safetensors"


@dataclass(frozen=True)
class Learner:
    """What a step changes."""

    model: NeuGrasp
    average: AveragedModel
    """The moving average of the weights: what is validated and shipped."""
    optimizer: torch.optim.Adam

    @classmethod
    def of(cls, model: NeuGrasp, config: TrainConfig) -> Learner:
        """A learner at its start."""

        def averaged(average: Tensor, now: Tensor, count: Tensor | int) -> Tensor:
            # A young average forgets its random start sooner.
            decay = min(config.average, (1 + int(count)) / (10 + int(count)))
            return torch.lerp(now, average, decay)

        optimizer = torch.optim.Adam(model.parameters(), lr=config.learning_rate)
        return cls(model, AveragedModel(model, avg_fn=averaged), optimizer)

    def update(self, gradient_clip: float) -> None:
        """One step of the optimiser along the gradients, which are used up, and of the average."""
        torch.nn.utils.clip_grad_norm_(self.model.parameters(), gradient_clip)
        self.optimizer.step()
        self.optimizer.zero_grad(set_to_none=True)
        self.average.update_parameters(self.model)

    @property
    def smooth(self) -> NeuGrasp:
        """The network with averaged weights."""
        return cast(NeuGrasp, self.average.module)


def save_state(folder: Path, learner: Learner, step: int, config: TrainConfig) -> None:
    """Writes weights, their average, Adam's moments and the number of finished steps, whole or not at all."""
    model, optimizer = learner.model, learner.optimizer
    names = {id(parameter): name for name, parameter in model.named_parameters()}
    tensors = {f"model.{name}": tensor for name, tensor in model.state_dict().items()}
    tensors |= {f"average.{name}": tensor for name, tensor in learner.average.state_dict().items()}
    for parameter, moments in optimizer.state.items():
        for key, value in moments.items():
            tensors[f"adam.{key}.{names[id(parameter)]}"] = torch.as_tensor(value)
    metadata = {"step": str(step), "config": _fingerprint(config)}
    temporary = folder / f".{STATE}.{os.getpid()}"
    try:
        save_file(
            {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()},
            temporary,
            metadata,
        )
        temporary.replace(folder / STATE)
    finally:
        temporary.unlink(missing_ok=True)


def load_state(folder: Path, learner: Learner, config: TrainConfig) -> int:
    """Puts a saved state back and gives the number of finished steps; 0 where nothing was saved.

    Raises `InputError` where the state is damaged or belongs to another configuration.
    """
    path = folder / STATE
    if not path.is_file():
        return 0
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata()
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cannot be read ({error}); remove it to start again") from error
    if metadata["config"] != _fingerprint(config):
        raise InputError(
            f"{path}: belongs to a run of another recipe, number of steps or seed; "
            f"continue with the same or choose another --out"
        )
    learner.model.load_state_dict(_under(tensors, "model."))
    learner.average.load_state_dict(_under(tensors, "average."))
    for name, parameter in learner.model.named_parameters():
        keys = ("step", "exp_avg", "exp_avg_sq")
        if f"adam.step.{name}" in tensors:
            learner.optimizer.state[parameter] = {
                key: tensors[f"adam.{key}.{name}"].to(_place(key, parameter)) for key in keys
            }
    return int(metadata["step"])


def _place(key: str, parameter: Tensor) -> torch.device:
    return torch.device("cpu") if key == "step" else parameter.device


def _under(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {name[len(prefix) :]: tensor for name, tensor in tensors.items() if name.startswith(prefix)}


def _fingerprint(config: TrainConfig) -> str:
    return json.dumps(asdict(config), sort_keys=True)
