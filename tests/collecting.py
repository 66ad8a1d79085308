"""What `collect` needs of the outside, without weights and Blender: a detector, a photographer, a child."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from neugrasp.data.world import Cell, Scene
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import PHOTOS, DetectorSpec
from neugrasp.geometry.pose import rigid
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Observation
from neugrasp.operation.collect import collect
from neugrasp.operation.command import Collect
from neugrasp.simulation.objects import ObjectLibrary

DOWN = np.diag([1.0, -1.0, -1.0])


class Combing:
    """Goes straight down everywhere around the middle of the table; looks at nothing."""

    def __init__(self, options: DetectorOptions):
        self.gripper = Gripper.load(options.gripper)

    def detect(self, seen: Observation) -> Detection:
        """36 grasps, 2.5 cm apart, 2 cm above the table."""
        workspace = seen.workspace
        x, y, z = workspace.centre
        places = [(x + 0.025 * i, y + 0.025 * j, z + 0.02) for i in range(-3, 3) for j in range(-3, 3)]
        return Detection(
            Grasps.of(Grasp(rigid(DOWN, place), 0.04, 0.9) for place in places), workspace, self.gripper
        )


SPEC = DetectorSpec(PHOTOS, Combing)


class Drawing:
    """Takes the place of `Renderer`: noise that depends on the scene, and bright dots for its bodies."""

    def __init__(self, threads: int = 1):
        self.waits = 0.0

    def __enter__(self) -> Drawing:
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[np.ndarray]:
        """One photo per camera."""
        time.sleep(self.waits)
        photos = []
        for index in camera_indices:
            camera = cell.cameras[index]
            rng = np.random.default_rng([cell.seed, index])
            photo = rng.integers(90, 130, (camera.height, camera.width, 3), dtype=np.uint8)
            for body in scene.bodies if scene else ():
                (u, v), _ = camera.project(np.array(body.position))
                column, row = round(float(u)), round(float(v))
                photo[max(row - 12, 0) : row + 12, max(column - 12, 0) : column + 12] = (200, 40, 30)
            photos.append(photo)
        return photos


class Slow(Drawing):
    """Gives a test time to kill the run."""

    def __init__(self, threads: int = 1):
        self.waits = 0.1


def little(out: Path, scenes: int = 3) -> Collect:
    """Three scenes, six grasps in each."""
    return Collect(out=out, scenes=scenes, grasps=6, detector="collecting:SPEC", seed=5)


def collect_a_little(out: Path) -> None:
    """For a child that will be killed."""
    collect(little(out), Slow)
