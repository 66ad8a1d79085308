"""Every grasp that was executed in a scene, whatever came of it, and the states of the scene that it met.

`GraspLabels` keep one yaw of a point; an evaluator of grasps learns from all of them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.fields import Fields
from neugrasp.data.npz import Columns, check_columns, npz_arrays, npz_bytes
from neugrasp.data.strict_json import parse_json
from neugrasp.data.world import Scene, scene_from_json, scene_to_json
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import USUAL

COLUMNS: Columns = {
    "positions": (np.float32, (3,)),
    "quaternions": (np.float32, (4,)),
    "widths": (np.float32, ()),
    "success": (np.bool_, ()),
    "reasons": (np.uint8, ()),
    "states": (np.uint8, ()),
    "series": (np.uint8, ()),
}
"""The type of a column and the shape of a trial's entry in it."""
KINDS = {name: np.dtype(kind).kind for name, (kind, _) in COLUMNS.items()} | {"distances": "f", "about": "u"}
_MOST = 255
"""States, series and reasons in one file; they are told by a byte."""


@dataclass(frozen=True)
class State:
    """What stood on the table when grasps were tried."""

    scene: Scene
    """The bodies that were there, at rest; it rebuilds the state exactly. Without materials."""
    distance: NDArray[np.float32]
    """Their mesh distance (r, r, r), as that of a `Record`."""


@dataclass(frozen=True)
class Trials:
    """k grasps that were executed, each from rest, with the gripper opened all the way."""

    positions: NDArray[np.float32]
    """(k, 3) the TCP in the workspace frame, metres: where the hand closes, not a grasp point."""
    quaternions: NDArray[np.float32]
    """(k, 4) `workspace_from_grasp`, xyzw, w >= 0."""
    widths: NDArray[np.float32]
    """(k,) opening with the object in hand, metres; the largest opening where the grasp failed."""
    success: NDArray[np.bool_]
    """(k,)"""
    reasons: NDArray[np.uint8]
    """(k,) how it ended: index into `reason_names`."""
    states: NDArray[np.uint8]
    """(k,) what it met: index into `met`."""
    series: NDArray[np.uint8]
    """(k,) what it was tried for: index into `made`."""
    reason_names: tuple[str, ...]
    """Such as "success" or "collision at the pre-grasp"."""
    met: tuple[State, ...]
    made: tuple[Mapping[str, Any], ...]
    """How each series was drawn; two that are equal hold the same trials."""

    def __len__(self) -> int:
        return len(self.success)


def joined(one: Trials | None, other: Trials) -> Trials:
    """The trials of both; a state, a series and a reason that both have are told once."""
    if one is None:
        return other
    scenes = [state.scene for state in one.met]
    new = tuple(state for state in other.met if state.scene not in scenes)
    met, names, made = (
        one.met + new,
        _union(one.reason_names, other.reason_names),
        _union(one.made, other.made),
    )
    scenes += [state.scene for state in new]
    renumbered = {
        "states": [scenes.index(state.scene) for state in other.met],
        "reasons": [names.index(name) for name in other.reason_names],
        "series": [made.index(series) for series in other.made],
    }
    columns = {name: getattr(other, name) for name in COLUMNS}
    columns |= {name: np.array(table, np.uint8)[columns[name]] for name, table in renumbered.items()}
    both = {name: np.concatenate([getattr(one, name), column]) for name, column in columns.items()}
    return Trials(**both, reason_names=names, met=met, made=made)


def _union(one: tuple[Any, ...], other: tuple[Any, ...]) -> tuple[Any, ...]:
    return one + tuple(item for item in other if item not in one)


def trials_to_bytes(trials: Trials) -> bytes:
    """Trials as a compressed npz; the same trials give the same bytes."""
    about = {
        "format": "neugrasp-trials",
        "version": 1,
        "reasons": trials.reason_names,
        "states": [json.loads(scene_to_json(state.scene)) for state in trials.met],
        "series": trials.made,
    }
    columns = {name: getattr(trials, name).astype(kind) for name, (kind, _) in COLUMNS.items()}
    resolution = trials.met[0].distance.shape[0] if trials.met else USUAL.resolution
    distances = np.array([state.distance for state in trials.met], np.float16)
    return npz_bytes(
        **columns,
        distances=distances.reshape(-1, *(resolution,) * 3),
        about=np.frombuffer(json.dumps(about).encode(), np.uint8),
    )


def trials_from_bytes(data: bytes, source: str) -> Trials:
    """The inverse of `trials_to_bytes`. Raises `InputError` naming `source` where it is damaged."""
    arrays = npz_arrays(data, KINDS, source)
    about = _about(arrays.pop("about"), source)
    scenes = [scene_from_json(json.dumps(state), source) for state in about["states"]]
    distances = arrays.pop("distances")
    resolution = distances.shape[-1]
    if distances.shape != (len(scenes), *(resolution,) * 3):
        raise InputError(f"{source}: distances has shape {distances.shape}; it has {len(scenes)} states")
    met = tuple(State(s, d.astype(np.float32)) for s, d in zip(scenes, distances, strict=True))
    _check(arrays, {"reasons": about["reasons"], "states": met, "series": about["series"]}, source)
    return Trials(**arrays, reason_names=tuple(about["reasons"]), met=met, made=tuple(about["series"]))


def _about(array: NDArray[Any], source: str) -> dict[str, Any]:
    about = Fields(source, parse_json(array.tobytes(), source), "about.")
    about.expect("neugrasp-trials", 1)
    for key in ("reasons", "states", "series"):
        if len(about.list(key)) > _MOST:
            raise about.refuse(key, f"has {len(about.data[key])} entries; at most {_MOST} can be named")
    if not all(isinstance(reason, str) for reason in about.data["reasons"]):
        raise about.refuse("reasons", "are not all words")
    return about.data


def _check(arrays: dict[str, NDArray[Any]], tables: dict[str, Any], source: str) -> None:
    count = len(arrays["success"])
    check_columns(arrays, COLUMNS, count, source)
    for name, table in tables.items():
        if count and arrays[name].max() >= len(table):
            raise InputError(f"{source}: {name} names number {arrays[name].max()} of {len(table)}")
