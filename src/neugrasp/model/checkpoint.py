"""Weights on disk: safetensors with the configuration, the commit and a format version inside."""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass, fields
from importlib import resources
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from neugrasp.errors import InputError
from neugrasp.model.config import ModelConfig
from neugrasp.model.network import NeuGrasp

FORMAT = "neugrasp-weights"
VERSION = 1


@dataclass(frozen=True)
class Checkpoint:
    """What a weights file holds."""

    config: ModelConfig
    tensors: dict[str, Tensor]
    about: dict[str, Any]
    """Recipe, steps, commit, data: whatever the trainer noted."""

    def model(self) -> NeuGrasp:
        """The network with these weights, float32, ready to predict."""
        network = NeuGrasp(self.config)
        network.load_state_dict({name: tensor.float() for name, tensor in self.tensors.items()})
        return network.eval()


def save_checkpoint(path: Path, model: NeuGrasp, about: dict[str, Any], half: bool = False) -> None:
    """Writes the weights whole or not at all; `half` stores float16, for shipping."""
    tensors = {
        name: (tensor.half() if half else tensor.float()).detach().cpu().contiguous()
        for name, tensor in model.state_dict().items()
    }
    metadata = {
        "format": FORMAT,
        "version": str(VERSION),
        "config": json.dumps(asdict(model.config)),
        "about": json.dumps(about),
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        save_file(tensors, temporary, metadata)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


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
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: not a readable safetensors file ({error})") from error
    if metadata.get("format") != FORMAT:
        raise InputError(f"{path}: not NeuGrasp weights (format {metadata.get('format')!r}, not {FORMAT!r})")
    if int(metadata.get("version", "0")) > VERSION:
        raise InputError(
            f"{path}: format version {metadata['version']} is newer than this program reads ({VERSION}); "
            f"update neugrasp"
        )
    config = _config_from(json.loads(metadata["config"]), path)
    _check_tensors(path, config, tensors)
    return Checkpoint(config, tensors, json.loads(metadata.get("about", "{}")))


def _config_from(data: dict[str, Any], path: Path) -> ModelConfig:
    known = {field.name for field in fields(ModelConfig)}
    if unknown := set(data) - known:
        raise InputError(f"{path}: its configuration has unknown entries {sorted(unknown)}; update neugrasp")
    entries: dict[str, Any] = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
    return ModelConfig(**entries)


def _check_tensors(path: Path, config: ModelConfig, tensors: dict[str, Tensor]) -> None:
    with torch.device("meta"):
        expected = NeuGrasp(config).state_dict()
    if missing := set(expected) ^ set(tensors):
        raise InputError(f"{path}: tensors do not fit its configuration: {sorted(missing)[:3]} ...")
    for name, tensor in tensors.items():
        if tensor.shape != expected[name].shape:
            raise InputError(
                f"{path}: tensor {name} has shape {tuple(tensor.shape)}, not {tuple(expected[name].shape)}"
            )
        if not torch.isfinite(tensor).all():
            raise InputError(f"{path}: tensor {name} holds NaN or infinite values; the file is damaged")
