"""Keys of the JSON files that users hand in: which are known, and which of the others would bend geometry.

A reader says which keys it understands. Of the rest, those that change where a pixel or a camera is are
refused unless they say that nothing is changed; all others are named in a warning.
"""

from __future__ import annotations

import difflib
import logging
import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.bends import NO_PINHOLE, bend_of
from neugrasp.data.spelling import is_foreign, plain
from neugrasp.errors import InputError

OF_A_CAMERA = re.compile(
    r"(?!depth|ir|infra)(\w*(calib|camera|lens|intrins|colou?r|rgb|optic|sensor)\w*|cams?\d*|meta(data)?|info|"
    r"settings|config|dataparser|normali[sz]ation)"
)
"""Objects within a file that describe the camera of its photos, or how its poses were made."""
OF_ANOTHER = re.compile(r"(depth|ir\d*$|infra|gripper|robot)\w*")
"""Objects within those that describe something else."""
REMARKS = frozenset(
    {"name", "comment", "comments", "note", "notes", "remark", "description", "author", "date", "title"}
    | {"format", "version", "source", "created", "timestamp", "time", "stamp", "header", "frameid", "frame"}
    | {"parent", "child", "childframeid", "id", "label"}
)
"""Keys in plain letters that say nothing of any number."""
PLACES = {"position", "translation", "t", "xyz", "origin", "trans", "tvec"}
TURNS = re.compile(r"q|r|(quat|rot|rpy|euler|orientation|rvec|axis)\w*")
"""Keys of a pose that is written as an object."""


def refuse_bends(
    entry: Mapping[str, Any], known: Collection[str], where: str, remedy: str | None = None
) -> None:
    """Raises `InputError` for a key outside `known` that would bend the geometry, with what to do; also for
    one within an object that is not known itself, but describes a camera by its name, and for poses."""
    used = [matrix for key in known if (matrix := _matrix_of(entry.get(key))) is not None]
    for key, value in entry.items():
        if key in known:
            continue
        if bend := bend_of(key, value):
            what = f"{key!r} {bend.what}, which is not read here"
            raise InputError(f"{where}: {what}; {remedy or bend.remedy}")
        if not is_remark(key) and is_foreign(key) and _may_bend(value):
            raise InputError(
                f"{where}: {key!r} is in letters that are not read here, and may say something of a "
                f"camera; leave it away (as a remark it begins with an underscore: '_{key}')"
            )
        if not is_remark(key) and _is_another_pose(value, used):
            hint = _meant(key, known) or "; leave it away"
            raise InputError(
                f"{where}: {key!r} is a pose, which is not read here{hint} (as a remark it begins with an "
                f"underscore: '_{key}')"
            )
        if OF_A_CAMERA.fullmatch(plain(key)):
            _refuse_inside(value, f"{where}: {key}", remedy)


def _refuse_inside(value: Any, where: str, remedy: str | None) -> None:
    """The same for all objects within one that describes a camera."""
    for part in value if isinstance(value, list) else [value]:
        if isinstance(part, Mapping):
            refuse_bends(part, (), where, remedy)
            for key, deeper in part.items():
                if not OF_ANOTHER.fullmatch(plain(key)) and not OF_A_CAMERA.fullmatch(plain(key)):
                    _refuse_inside(deeper, f"{where}: {key}", remedy)


def refuse_unknown(entry: Mapping[str, Any], known: Collection[str], where: str) -> None:
    """Raises `InputError` for a key outside `known` that is no remark, with the known one that is most like
    it: for objects in which every key is a measure, so that one left out is another measure."""
    for key in entry:
        if key not in known and not is_remark(key):
            hint = _meant(key, known)
            raise InputError(f"{where}: the key {key!r} is not known{hint or '; leave it away'}")


def is_remark(key: str) -> bool:
    """Whether a key is for people alone."""
    return key.startswith(("_", "$", "//")) or plain(key) in REMARKS


def _may_bend(value: Any) -> bool:
    """Whether a value is more than a note: it holds numbers, switches something on, or names a lens."""
    if isinstance(value, str):
        return re.search(NO_PINHOLE, plain(value)) is not None
    if isinstance(value, Mapping | list):
        return any(map(_may_bend, value.values() if isinstance(value, Mapping) else value))
    return value not in (None, 0)


def warn_of_unknown(
    entries: Iterable[Mapping[str, Any]], known: Collection[str], file: Path | str, logger: logging.Logger
) -> None:
    """Names each key outside `known` once, with the known one that is most like it; a key that begins with an
    underscore, a dollar or a slash is a remark, and one that bends geometry is refused, not ignored."""
    for key, value in {key: value for entry in entries for key, value in entry.items()}.items():
        if key in known or key.startswith(("_", "$", "//")) or bend_of(key, value):
            continue
        logger.warning("%s: the key %r is not known and ignored%s", file, key, _meant(key, known))


def _meant(key: str, known: Collection[str]) -> str:
    """The known key that is most like another, as a question."""
    like = difflib.get_close_matches(plain(key), [plain(word) for word in known], n=1)
    meant = next((word for word in sorted(known) if like and plain(word) == like[0]), None)
    return f"; did you mean {meant!r}?" if meant else ""


def _matrix_of(value: Any) -> np.ndarray | None:
    """A 4 x 4 or 3 x 4 matrix, by rows or in one list, as (3, 4); None for anything else."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if array.shape not in ((4, 4), (3, 4), (16,), (12,)) or not np.isfinite(array).all():
        return None
    return np.asarray(array.reshape(-1, 4)[:3])


def _is_another_pose(value: Any, used: list[np.ndarray]) -> bool:
    """Whether a value is a pose that is neither the identity nor one that is `used`."""
    if isinstance(value, Mapping):
        words = {plain(key) for key in value}
        return bool(words & PLACES) and any(map(TURNS.fullmatch, words))
    matrix = _matrix_of(value)
    if matrix is None or not np.allclose(matrix[:, :3] @ matrix[:, :3].T, np.eye(3), atol=1e-3):
        return False
    inverse = np.column_stack([matrix[:, :3].T, -matrix[:, :3].T @ matrix[:, 3]])
    return not any(
        np.allclose(one, other, atol=1e-6) for one in (np.eye(4)[:3], *used) for other in (matrix, inverse)
    )
