"""Weights on disk: safetensors with the configuration, the commit and a format version inside."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from importlib import resources
from pathlib import Path
from typing import Any, Protocol, TypeVar

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import parse_json
from neugrasp.errors import InputError, WriteError
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.model.config import ModelConfig, NetworkConfig
from neugrasp.model.network import NeuGrasp
from neugrasp.output import whole_file

FORMAT = "neugrasp-weights"
NEUGRASP = "neugrasp"
"""The network that weights are of which do not name another."""
VERSION = 1
LARGEST, DEEPEST = 4096, 64
"""Of any size in a configuration, and of blocks one behind the other."""
CUBE = ("size", "resolution", "table_height", "truncation")
"""What of a workspace matters to a network: `Workspace.cube`."""
FLOATS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)


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
    tensors = {
        name: (tensor.half() if half else tensor.float()).detach().cpu().contiguous()
        for name, tensor in model.state_dict().items()
    }
    metadata = {
        "format": FORMAT,
        "version": str(VERSION),
        "config": json.dumps(asdict(model.config)),
        "workspace": json.dumps(dict(zip(CUBE, model.workspace.cube, strict=True))),
        "about": json.dumps(about),
        **({} if network == NEUGRASP else {"network": network}),
    }
    with whole_file(path) as part:
        try:
            save_file(tensors, part, metadata)
        except SafetensorError as error:
            raise WriteError(f"{path}: cannot be written ({error})") from error


def shipped_weights() -> dict[str, Path]:
    """The weights that come with the package, by name."""
    folder = Path(str(resources.files("neugrasp"))) / "weights"
    return {path.stem: path for path in sorted(folder.glob("*.safetensors"))}


def find_weights(name_or_path: str | Path) -> Path:
    """The file of shipped weights, by name, or of the user's own; raises `InputError` when there is none."""
    shipped = shipped_weights()
    if str(name_or_path) in shipped:
        return shipped[str(name_or_path)]
    path = Path(name_or_path)
    if not path.is_file():
        raise InputError(
            f"no weights {str(name_or_path)!r}: neither a file nor one of the shipped weights "
            f"({', '.join(shipped) or 'none'})"
        )
    return path


def load_checkpoint(name_or_path: str | Path) -> Checkpoint:
    """Reads weights by name or from a file. Raises `InputError` on a damaged, foreign or newer file."""
    path = find_weights(name_or_path)
    metadata, tensors = _weights_of(path, NEUGRASP)
    config = _config_from(described(path, metadata, "config"))
    _check_tensors(path, partial(NeuGrasp, config), tensors)
    about = described(path, metadata, "about") if "about" in metadata else Fields(str(path), {}, "about.")
    return Checkpoint(config, tensors, _checked_about(about), workspace_from(path, metadata))


Config = TypeVar("Config", bound=NetworkConfig)
Network = TypeVar("Network", bound=nn.Module)


def load_network(
    path: Path, name: str, kind: type[Config], build: Callable[[Config, Workspace], Network]
) -> Network:
    """A network of another name with its weights, float32, ready to predict. Raises as `load_checkpoint`."""
    metadata, tensors = _weights_of(path, name)
    given = described(path, metadata, "config")
    known = {one.name: getattr(kind(), one.name) for one in fields(kind)}
    given.only(known)
    config = kind(**{entry: _entry(given, entry, known[entry]) for entry in given.data})
    workspace = workspace_from(path, metadata)
    _check_tensors(path, partial(build, config, workspace), tensors)
    network = build(config, workspace)
    network.load_state_dict({key: tensor.float() for key, tensor in tensors.items()})
    return network.eval()


def _weights_of(path: Path, network: str) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Metadata and tensors of weights of the network of that name."""
    metadata, tensors = read_weights(path, FORMAT, "NeuGrasp weights")
    found = metadata.get("network", NEUGRASP)
    if found != network:
        raise InputError(f"{path}: weights of the network {found[:40]!r}, not {network!r}; give --detector")
    return metadata, tensors


def read_weights(path: Path, kind: str, words: str) -> tuple[dict[str, str], dict[str, Tensor]]:
    """Metadata and tensors of a weights file of the format `kind`, which messages call `words`.

    Raises `InputError` on a damaged, foreign or newer file.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (
        SafetensorError,
        OSError,
        RuntimeError,
        ValueError,
        TypeError,
        LookupError,
        AttributeError,
    ) as error:
        raise InputError(f"{path}: not a readable safetensors file ({error})") from error
    if metadata.get("format") != kind:
        found = f"{metadata.get('format')!r}"[:40]
        raise InputError(f"{path}: not {words} (format {found}, not {kind!r})")
    _check_version(path, metadata.get("version", ""))
    return metadata, tensors


def _check_version(path: Path, version: str) -> None:
    if version.isascii() and version.isdigit() and len(version) < 10 and int(version) > VERSION:
        raise InputError(
            f"{path}: format version {version} is newer than this program reads ({VERSION}); update neugrasp"
        )
    if version != str(VERSION):
        raise InputError(f"{path}: format version {version[:20]!r}; this program reads {VERSION}")


def described(path: Path, metadata: dict[str, str], entry: str) -> Fields:
    """The JSON object in the metadata."""
    if entry not in metadata:
        raise InputError(f"{path}: not NeuGrasp weights (no {entry} in its metadata)")
    where = f"{path}: {entry}"
    return Fields(str(path), Fields(where, parse_json(metadata[entry], where)).data, f"{entry}.")


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


def workspace_from(path: Path, metadata: dict[str, str]) -> Workspace:
    """The cube that is written down; weights of before it was are for the usual one."""
    if "workspace" not in metadata:
        return USUAL
    cube = described(path, metadata, "workspace")
    cube.only(CUBE)
    for name in CUBE:
        cube.get(name)
    return Workspace.from_dict(cube)


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


def _check_tensors(path: Path, build: Callable[[], nn.Module], tensors: dict[str, Tensor]) -> None:
    try:
        with torch.device("meta"):
            expected = build().state_dict()
    except (ValueError, RuntimeError, TypeError, ArithmeticError, AssertionError) as error:
        raise InputError(f"{path}: its configuration describes no network ({error})") from error
    if missing := set(expected) ^ set(tensors):
        raise InputError(f"{path}: tensors do not fit its configuration: {sorted(missing)[:3]} ...")
    for name, tensor in tensors.items():
        if tensor.dtype not in FLOATS:
            raise InputError(f"{path}: tensor {name} is of type {tensor.dtype}; weights are floating numbers")
        if tensor.shape != expected[name].shape:
            raise InputError(
                f"{path}: tensor {name} has shape {tuple(tensor.shape)}, not {tuple(expected[name].shape)}"
            )
        if not torch.isfinite(tensor.float()).all():
            raise InputError(f"{path}: tensor {name} holds NaN or infinite values; the file is damaged")
