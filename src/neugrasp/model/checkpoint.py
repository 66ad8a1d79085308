"""Weights on disk: safetensors with the configuration, the commit and a format version inside."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, Protocol, TypeVar

from torch import Tensor, nn

from neugrasp.data.fields import Fields
from neugrasp.errors import InputError, WeightsError, told_as
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.config import ModelConfig, NetworkConfig
from neugrasp.model.network import NeuGrasp
from neugrasp.model.weights_file import (
    check_tensors,
    described,
    named_file,
    read_weights,
    workspace_from,
    write_weights,
)

FORMAT = "neugrasp-weights"
NEUGRASP = "neugrasp"
"""The network that weights are of which do not name another."""
VERSION = 1
LARGEST, DEEPEST = 4096, 64
"""Largest size in a configuration, and most blocks one behind the other."""


@dataclass(frozen=True)
class Checkpoint:
    """What a weights file holds."""

    config: ModelConfig
    tensors: dict[str, Tensor]
    about: dict[str, Any]
    """Recipe, steps, commit, data: whatever the trainer noted."""
    workspace: Workspace = field(default_factory=Workspace)
    """The cube that the network was trained for."""

    def model(self) -> NeuGrasp:
        """The network with these weights, float32, ready to predict."""
        network = NeuGrasp(self.config, self.workspace)
        network.load_state_dict({name: tensor.float() for name, tensor in self.tensors.items()})
        return network.eval()


class Described(Protocol):
    """A network that says what it is: what `save_checkpoint` writes down."""

    config: Any
    """A `NetworkConfig`."""
    workspace: Workspace

    def state_dict(self) -> Mapping[str, Tensor]:
        """As PyTorch's."""
        ...


def save_checkpoint(
    path: Path, model: Described, about: dict[str, Any], half: bool = False, network: str = NEUGRASP
) -> None:
    """Writes the weights whole or not at all; `half` stores float16, for shipping. `network` is its name."""
    named = {} if network == NEUGRASP else {"network": network}
    write_weights(path, FORMAT, model.state_dict(), asdict(model.config), model.workspace, about, half, named)


def ship_checkpoint(trained: Path, shipped: Path, threshold: float) -> dict[str, Any]:
    """Writes weights of whatever network once more, in float16, with the threshold of scores that they are
    used with; what is noted with them now. Raises as `load_checkpoint`."""
    metadata, tensors = read_weights(trained, FORMAT, "NeuGrasp weights")
    about = {**_checked_about(_about(trained, metadata)), "threshold": threshold}
    more = {name: metadata[name] for name in ("network",) if name in metadata}
    config, workspace = described(trained, metadata, "config").data, workspace_from(trained, metadata)
    write_weights(shipped, FORMAT, tensors, config, workspace, about, half=True, more=more)
    return about


def shipped_weights() -> dict[str, Path]:
    """The weights that come with the package, by name."""
    folder = Path(str(resources.files("neugrasp"))) / "weights"
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


@told_as(WeightsError)
def find_weights(name_or_path: str | Path) -> Path:
    """The file of shipped weights, by name, or of the user's own; raises `WeightsError` where none is."""
    return named_file(name_or_path, shipped_weights(), "weights", "weights")


@told_as(WeightsError)
def load_checkpoint(name_or_path: str | Path) -> Checkpoint:
    """Reads weights by name or from a file. Raises `WeightsError` on a damaged, foreign or newer file."""
    path = find_weights(name_or_path)
    metadata, tensors = _weights_of(path, NEUGRASP)
    config = _config_from(described(path, metadata, "config"))
    check_tensors(path, partial(NeuGrasp, config), tensors)
    about = _checked_about(_about(path, metadata))
    return Checkpoint(config, tensors, about, workspace_from(path, metadata))


Config = TypeVar("Config", bound=NetworkConfig)
Network = TypeVar("Network", bound=nn.Module)


@told_as(WeightsError)
def load_network(
    path: Path, name: str, kind: type[Config], build: Callable[[Config, Workspace], Network]
) -> Network:
    """A network of another name with its weights, float32, ready to predict.

    Raises `WeightsError` as `load_checkpoint` does.
    """
    metadata, tensors = _weights_of(path, name)
    given = described(path, metadata, "config")
    known = {one.name: getattr(kind(), one.name) for one in fields(kind)}
    given.only(known)
    config = kind(**{entry: _entry(given, entry, known[entry]) for entry in given.data})
    workspace = workspace_from(path, metadata)
    check_tensors(path, partial(build, config, workspace), tensors)
    network = build(config, workspace)
    network.load_state_dict({key: tensor.float() for key, tensor in tensors.items()})
    return network.eval()


@told_as(WeightsError)
def network_of(path: Path) -> str:
    """The name of the network that weights are of. Raises `WeightsError`."""
    return read_weights(path, FORMAT, "NeuGrasp weights")[0].get("network", NEUGRASP)


def notes_of(path: Path, name: str) -> dict[str, Any]:
    """What was noted with the weights of a network of another name. Raises as `load_checkpoint`."""
    metadata, _ = _weights_of(path, name)
    return _checked_about(_about(path, metadata))


def _about(path: Path, metadata: dict[str, str]) -> Fields:
    return described(path, metadata, "about") if "about" in metadata else Fields(str(path), {}, "about.")


def _weights_of(path: Path, network: str) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Metadata and tensors of weights of the network of that name."""
    metadata, tensors = read_weights(path, FORMAT, "NeuGrasp weights")
    found = metadata.get("network", NEUGRASP)
    if found != network:
        raise InputError(f"{path}: weights of the network {found[:40]!r}, not {network!r}; give --detector")
    return metadata, tensors


def _config_from(told: Fields) -> ModelConfig:
    known = {one.name: one.default for one in fields(ModelConfig)}
    if unknown := set(told.data) - known.keys():
        names = sorted(unknown)[:3]
        raise InputError(f"{told.source}: its configuration has unknown entries {names}; update neugrasp")
    entries = {name: _entry(told, name, known[name]) for name in told.data}
    config = ModelConfig(**entries)
    for name in ("feature_dim", "volume_dim"):
        if getattr(config, name) < 2:
            raise told.refuse(name, f"is {getattr(config, name)}; layers of half as many must have one")
    if config.image_size % 16:
        raise told.refuse("image_size", f"is {config.image_size}; it must be a multiple of 16")
    return config


def _entry(described: Fields, name: str, default: Any) -> Any:
    """An entry of the configuration, of the type and length of its default."""
    if isinstance(default, bool):
        return described.flag(name)
    if isinstance(default, tuple):
        row = described.list(name)
        if len(row) != len(default):
            raise described.refuse(name, f"has {len(row)} numbers; it must have {len(default)}")
        numbered = Fields(described.source, {f"{i}": x for i, x in enumerate(row)}, f"config.{name}.")
        most = DEEPEST if name == "encoder_blocks" else LARGEST
        return tuple(numbered.whole(f"{i}", 1, most) for i in range(len(row)))
    if isinstance(default, float):
        return described.number(name, -1e9, 1e9)
    if isinstance(default, str):
        return described.text(name)
    return described.whole(name, 1, LARGEST)


def _checked_about(about: Fields) -> dict[str, Any]:
    """The notes, of which those that the program heeds have their type."""
    if "threshold" in about.data:
        about.number("threshold", 0, 1)
    if "recipe" in about.data:
        about.text("recipe")
    for count in {"steps", "scenes"} & about.data.keys():
        about.whole(count, 0, 10**12)
    return about.data
