"""Lessons for an evaluator that need no physics: a ball, and grasps from above."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from neugrasp.data.lessons import ABOUT, Lesson, about_lessons, write_lesson
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

WORKSPACE = Workspace()


def lesson(seed: int, count: int = 40, near: float = 0.03) -> Lesson:
    """A ball; a grasp from above holds where the TCP is as near its middle, metres."""
    rng = np.random.default_rng(seed)
    centre = np.array([*rng.uniform(0.1, 0.2, 2), 0.08])
    places = WORKSPACE.voxel_centres()
    distance = np.minimum(np.linalg.norm(places - centre, axis=-1) - 0.025, places[..., 2] - 0.05)
    positions = centre + rng.uniform(-0.04, 0.04, (count, 3)) * [1, 1, 0]
    held = np.linalg.norm(positions - centre, axis=1) < near
    return Lesson(
        np.clip(distance / WORKSPACE.truncation, -1, 1)[None].astype(np.float16),
        positions.astype(np.float32),
        np.tile(np.array([1, 0, 0, 0], np.float32), (count, 1)),
        held,
        np.ones(count, np.bool_),
        np.zeros(count, np.uint8),
    )


def write_lessons(folder: Path, count: int, gripper: str = "panda", near: float = 0.03) -> Path:
    """So many balls, tried with a gripper."""
    folder.mkdir(exist_ok=True)
    for seed in range(count):
        write_lesson(folder / f"ball-{seed:02d}.npz", lesson(seed, near=near))
    (folder / ABOUT).write_text(json.dumps(about_lessons(Gripper.load(gripper))))
    return folder
