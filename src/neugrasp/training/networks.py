"""Networks that can be trained, by name: how one is built, what it minimises, how it is judged.

Another one is a `NetworkSpec` in any module, named by a recipe of one's own (`TrainConfig.network`) as
module:NAME, or declared as an entry point of the group `neugrasp.networks`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from torch import nn

from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.network import NeuGrasp
from neugrasp.training.config import TrainConfig
from neugrasp.training.extensions import extension
from neugrasp.training.module import NetworkLosses, neugrasp_losses
from neugrasp.training.progress_picture import save_progress_picture
from neugrasp.training.samples import Sample, Truth
from neugrasp.training.validation import SurfaceNetwork, validate, validate_head

GROUP = "neugrasp.networks"


class HeldOut(Protocol):
    """Scenes that are not trained on."""

    @property
    def samples(self) -> Sequence[Sample]:
        """With photos."""
        ...

    @property
    def truths(self) -> Sequence[Truth]:
        """With or without photos."""
        ...


@dataclass(frozen=True)
class NetworkSpec:
    """What the trainer must know of a network."""

    build: Callable[[Any, Workspace], nn.Module]
    """From its configuration, a `NetworkConfig`, and the cube, which it keeps as `config` and `workspace`."""
    losses: NetworkLosses
    judge: Callable[[Any, HeldOut, TrainConfig, int, Path], dict[str, float]]
    """Network, held-out scenes, configuration, steps done, folder for pictures -> scores by name."""
    compares: bool = True
    """Whether its losses ask what changed against the empty table."""
    measures: bool = False
    """Whether it reads what a stereo sensor measured: scenes of `neugrasp generate --stereo`."""


def network_spec(name: str) -> NetworkSpec:
    """The network of that name. Raises `InputError` where there is none."""
    if name == "neugrasp":
        return NEUGRASP
    found = extension(GROUP, name, "network", ["neugrasp"])
    if not isinstance(found, NetworkSpec):
        raise InputError(f"network {name}: is a {type(found).__name__}, not a NetworkSpec")
    return found


def judge_surface(
    network: SurfaceNetwork, held_out: HeldOut, config: TrainConfig, step: int, folder: Path
) -> dict[str, float]:
    """The head on true grids; from the joint stage on everything, and a picture."""
    scores = validate_head(network, held_out.truths)
    sharpness = config.sharpness_at(step)
    if held_out.samples and step > config.head_steps:
        scores |= validate(network, held_out.samples, sharpness, render=config.weights.renders)
        save_progress_picture(folder / f"progress_{step:06d}.png", network, held_out.samples[0], sharpness)
    return scores


NEUGRASP = NetworkSpec(NeuGrasp, neugrasp_losses, judge_surface)
