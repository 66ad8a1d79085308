"""Grasps as graspnetAPI and AnyGrasp have them: rows of 17 numbers, x approaches, y closes.

A row is score, width, height, depth, the 3 x 3 rotation by rows, the translation, and the number of an
object. The origin is a point on the object; the finger tips reach `depth` beyond it, the palm stays 2 cm
before it.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from neugrasp.data.npz import DAMAGE, reason_of
from neugrasp.detection.files import FARTHEST
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, rigid
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper

COLUMNS = 17
HEIGHT = 0.02
"""Metres: the thickness of the fingers, as graspnetAPI's own detectors state it."""
PALM = 0.02
"""Metres from the palm to the origin in graspnetAPI's model of a gripper."""
NO_OBJECT = -1
GRASP_FROM_GRASPNET = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
"""Columns are graspnetAPI's axes in ours: its x is our z, its y our y, its z our -x."""


def encode(grasps: Sequence[Grasp], gripper: Gripper) -> Array:
    """Rows (n, 17), metres, in the frame of the grasps.

    The depth is chosen such that tips and palm of graspnetAPI's gripper lie where those of `gripper` do.
    """
    depth = gripper.finger_depth - PALM
    rows = np.empty((len(grasps), COLUMNS))
    for row, grasp in zip(rows, grasps, strict=True):
        row[:4] = grasp.score, grasp.width, HEIGHT, depth
        row[4:13] = (grasp.pose[:3, :3] @ GRASP_FROM_GRASPNET).ravel()
        row[13:16] = grasp.position + (_tip(gripper) - depth) * grasp.approach
        row[16] = NO_OBJECT
    return rows


def decode(rows: Array, gripper: Gripper) -> list[Grasp]:
    """The grasps of rows (n, 17), whatever their depths."""
    grasps = []
    for row in rows:
        rotation = row[4:13].reshape(3, 3) @ GRASP_FROM_GRASPNET.T
        tcp = row[13:16] + (row[3] - _tip(gripper)) * rotation[:, 2]
        grasps.append(Grasp(rigid(rotation, tcp), float(row[1]), float(row[0])))
    return grasps


def write(file: Path, grasps: Sequence[Grasp], gripper: Gripper) -> None:
    """An .npy file that `GraspGroup().from_npy` of graspnetAPI reads."""
    with file.open("wb") as stream:
        np.save(stream, encode(grasps, gripper))


def read(file: Path, gripper: Gripper) -> list[Grasp]:
    """The grasps of an .npy file. Raises `InputError` where it holds anything else."""
    try:
        with warnings.catch_warnings():
            # Numpy's words on a header of Python 2, which a damaged one may look like.
            warnings.simplefilter("ignore", UserWarning)
            rows = np.load(file, allow_pickle=False)
    except DAMAGE as error:
        raise InputError(f"{file}: no .npy file of numbers ({reason_of(error)})") from error
    if not isinstance(rows, np.ndarray) or rows.ndim != 2 or rows.shape[1] != COLUMNS:
        raise InputError(f"{file}: holds no rows of {COLUMNS} numbers")
    if rows.dtype.kind != "f" or not np.all(np.abs(rows) <= FARTHEST):
        raise InputError(f"{file}: holds something else than finite floating numbers")
    rotations = rows[:, 4:13].reshape(-1, 3, 3)
    if not np.allclose(rotations @ rotations.transpose(0, 2, 1), np.eye(3), atol=1e-3):
        raise InputError(f"{file}: columns 5 to 13 are no rotations")
    return decode(rows.astype(np.float64), gripper)


def _tip(gripper: Gripper) -> float:
    """Metres from the TCP to the finger tips."""
    return gripper.tip_height - gripper.tcp_height
