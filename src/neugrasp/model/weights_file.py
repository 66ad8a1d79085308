"""Weights of any network on disk: safetensors with its configuration, cube and notes in the metadata."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from neugrasp.data.fields import Fields
from neugrasp.data.strict_json import parse_json
from neugrasp.errors import InputError, WriteError
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.output import whole_file

VERSION = 1
CUBE = ("size", "resolution", "table_height", "truncation")
"""What of a workspace matters to a network: `Workspace.cube`."""
FLOATS = (torch.float16, torch.bfloat16, torch.float32, torch.float64)


def write_weights(
    path: Path,
    kind: str,
    state: Mapping[str, Tensor],
    config: Mapping[str, Any],
    workspace: Workspace,
    about: Mapping[str, Any],
    half: bool = False,
    more: Mapping[str, str] | None = None,
) -> None:
    """Writes weights of the format `kind` whole or not at all; `half` stores float16, for shipping.

    Raises `WriteError` where the file cannot be written.
    """
    tensors = {
        name: (tensor.half() if half else tensor.float()).detach().cpu().contiguous()
        for name, tensor in state.items()
    }
    metadata = {
        "format": kind,
        "version": str(VERSION),
        "config": json.dumps(config),
        "workspace": json.dumps(dict(zip(CUBE, workspace.cube, strict=True))),
        "about": json.dumps(about),
        **(more or {}),
    }
    with whole_file(path) as part:
        try:
            save_file(tensors, part, metadata)
        except SafetensorError as error:
            raise WriteError(f"{path}: cannot be written ({error})") from error


def named_file(name_or_path: str | Path, shipped: Mapping[str, Path], one: str, all_of_them: str) -> Path:
    """The shipped file of a name, or the user's own; raises `InputError` where there is none."""
    path = shipped.get(str(name_or_path), Path(name_or_path))
    if not path.is_file():
        raise InputError(
            f"no {one} {str(name_or_path)!r}: neither a file nor one of the shipped {all_of_them} "
            f"({', '.join(shipped) or 'none'})"
        )
    return path


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
    """The JSON object in the metadata. Raises `InputError` where there is none."""
    if entry not in metadata:
        raise InputError(f"{path}: not NeuGrasp weights (no {entry} in its metadata)")
    where = f"{path}: {entry}"
    return Fields(str(path), Fields(where, parse_json(metadata[entry], where)).data, f"{entry}.")


def workspace_from(path: Path, metadata: dict[str, str]) -> Workspace:
    """The cube that is written down; weights of before it was are for the usual one."""
    if "workspace" not in metadata:
        return USUAL
    cube = described(path, metadata, "workspace")
    cube.only(CUBE)
    for name in CUBE:
        cube.get(name)
    return Workspace.from_dict(cube)


def check_tensors(path: Path, build: Callable[[], nn.Module], tensors: dict[str, Tensor]) -> None:
    """Raises `InputError` where tensors are not those that the network needs, finite and of its shapes."""
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
