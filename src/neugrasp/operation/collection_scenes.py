"""Where scenes are laid, looked at and grasped in, to collect from: simulated tables, or a person's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from typing import Protocol

from neugrasp.detection.contract import Detector
from neugrasp.evaluation.commands import Evaluate
from neugrasp.evaluation.episode_runner import EpisodeRunner
from neugrasp.evaluation.workers import MakeSceneRenderer
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.operation.hardware import Hardware
from neugrasp.operation.person import Person
from neugrasp.operation.seen_table import SeenTable
from neugrasp.robot.interface import Robot
from neugrasp.robot.simulated_cameras import TruthCamera
from neugrasp.robot.wrist_camera import Photographs, Shot

THREADS = 2
"""That render the photos."""


class Scenes(Protocol):
    """Where scenes are laid, looked at and grasped in."""

    @property
    def gripper(self) -> Gripper:
        """The hand that tries."""
        ...

    @property
    def detector(self) -> Detector[Views]:
        """Whose picks are tried."""
        ...

    def lay(self, number: int) -> Robot[Views]:
        """The robot before scene `number`."""
        ...

    def again(self) -> Robot[Views] | None:
        """The robot before the same scene, as it was photographed; None where it is no more."""
        ...


class SimulatedScenes:
    """The beginnings of rounds, as often as they are wanted."""

    def __init__(self, runners: Sequence[EpisodeRunner]):
        self._runners = runners
        self._at = runners[0], runners[0].round(0)

    @property
    def gripper(self) -> Gripper:
        """The hand that tries."""
        return self._runners[0].world.gripper

    @property
    def detector(self) -> Detector[Views]:
        """Whose picks are tried."""
        return self._runners[0].detector

    def lay(self, number: int) -> Robot[Views]:
        """As `Scenes.lay`; the runners take turns."""
        runner = self._runners[number % len(self._runners)]
        self._at = runner, runner.round(number)
        return self.again()

    def again(self) -> Robot[Views]:
        """As `Scenes.again`."""
        runner, fixed = self._at
        return runner.robot(fixed, TruthCamera(runner.world))[0]


@contextmanager
def simulated_scenes(asked: Sequence[Evaluate], make: MakeSceneRenderer) -> Iterator[SimulatedScenes]:
    with ExitStack() as closing:
        scene_renderer = closing.enter_context(make(THREADS))
        runners = [EpisodeRunner(one, scene_renderer) for one in asked]
        for runner in runners:
            closing.enter_context(runner.world)
        yield SimulatedScenes(runners)


class CellScenes:
    """A real table: a pick changes it, and what is left is the next scene; a person lays new ones."""

    def __init__(
        self, hardware: Hardware, empty: tuple[Shot, ...], detector: Detector[Views], person: Person
    ):
        self.gripper, self.detector = hardware.camera.cell.gripper.gripper, detector
        self._table = SeenTable(Photographs(hardware.camera, empty))
        self._robot = Robot(self._table, hardware.manipulator, self._table)
        self._person = person
        self._is_new = False

    def lay(self, number: int) -> Robot[Views]:
        """As `Scenes.lay`. Asks a person where the table is empty, or was left as it was."""
        if not self._is_new or self._table.count() == 0:
            self._person.asked(f"scene {number}: lay objects on the table, then Enter; q: end here")
        self._is_new = False
        return self._robot

    def again(self) -> None:
        """Never: what was picked is gone, and what was not may lie elsewhere."""
        self._is_new = True
