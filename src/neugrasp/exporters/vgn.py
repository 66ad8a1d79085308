"""Grasps as VGN and GIGA have them: z approaches, y closes, the origin is the grasp point.

That point lies at the roots of the fingers, `tcp_depth` before the TCP. The file is a CSV with the columns of
VGN's own `grasps.csv`, without its scene_id, and with `score` where that has its label.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from neugrasp.detection.files import FARTHEST
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion, to_quaternion
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

COLUMNS = ("qx", "qy", "qz", "qw", "x", "y", "z", "width", "score")


def encode(grasps: Sequence[Grasp], gripper: Gripper) -> Array:
    """Rows (n, 9): quaternion xyzw, grasp point and width in metres, score; in the frame of the grasps."""
    rows = np.empty((len(grasps), len(COLUMNS)))
    for row, grasp in zip(rows, grasps, strict=True):
        row[:4] = to_quaternion(grasp.pose)
        row[4:7] = grasp.advanced(-gripper.tcp_depth).position
        row[7:] = grasp.width, grasp.score
    return rows


def decode(rows: Array, gripper: Gripper) -> list[Grasp]:
    """The grasps of rows (n, 9)."""
    return [
        Grasp(from_quaternion(row[:4], row[4:7]), float(row[7]), float(row[8])).advanced(gripper.tcp_depth)
        for row in rows
    ]


def write(file: Path, grasps: Sequence[Grasp], gripper: Gripper) -> None:
    """A CSV file."""
    with file.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(COLUMNS)
        writer.writerows(encode(grasps, gripper).tolist())


def read(file: Path, gripper: Gripper) -> list[Grasp]:
    """The grasps of a CSV file. Raises `InputError` where columns are missing or are no numbers."""
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            lines = list(csv.DictReader(stream))
        rows = np.array([[float(line[column]) for column in COLUMNS] for line in lines])
    except FileNotFoundError:
        raise InputError(f"{file}: missing") from None
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        raise InputError(f"{file}: needs the columns {','.join(COLUMNS)}, all numbers ({error!r})") from error
    rows = rows.reshape(-1, len(COLUMNS))
    if not np.all(np.abs(rows) <= FARTHEST):
        raise InputError(f"{file}: holds something else than finite numbers")
    if not np.allclose(np.linalg.norm(rows[:, :4], axis=1), 1, atol=0.01):
        raise InputError(f"{file}: holds a quaternion that has not the length 1")
    return decode(rows, gripper)
