"""A thousand seeded faults in picks: no motion after a fault, no hang, and every one ends with its reason."""

from __future__ import annotations

from dataclasses import dataclass, field
from importlib.util import find_spec

import numpy as np
import pytest

from neugrasp.detection.contract import Detection
from neugrasp.geometry.pose import Array
from neugrasp.grasp import Grasp, Grasps
from neugrasp.robot import arm_hand
from neugrasp.robot.arm_hand import ArmHand, Places
from neugrasp.robot.errors import (
    ConnectionLost,
    EmergencyStop,
    GripperFault,
    MotionTimeout,
    NoPlan,
    ProtectiveStop,
    RobotError,
)
from neugrasp.robot.interface import ArmState
from neugrasp.robot.limits import Guarded
from neugrasp.robot.motion import PickPlan
from neugrasp.robot.pick import DROPPED, REASONS, pick
from neugrasp.robot.trajectory import Trajectory
from neugrasp.robot.workcell import planner_of
from robot_cells import down_at, example

pytestmark = pytest.mark.skipif(find_spec("ompl") is None, reason="needs neugrasp[robot]")

CELL = example()
MOTION = planner_of(CELL)
GRASP = Grasp(down_at(0.5, 0.02, 0.06), 0.03)
FAULTS = (ConnectionLost, ProtectiveStop, EmergencyStop, MotionTimeout)
SEEDS = 1000
UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Fate:
    """What happens at which call, of arm and gripper together."""

    rng: np.random.Generator
    at: int
    """The call at which a fault comes."""
    calls: int = 0
    fault: RobotError | None = None
    moved_after: int = 0

    def call(self, moves: bool, kinds: tuple[type[RobotError], ...]) -> None:
        if self.fault is not None and moves:
            self.moved_after += 1
        self.calls += 1
        if self.calls == self.at:
            self.fault = kinds[self.rng.integers(len(kinds))](f"at call {self.at}")
        if self.fault is not None:
            raise self.fault


@dataclass
class FatefulArm:
    """Does what it is told until its fate; contacts end some motions early."""

    fate: Fate
    joints: Array
    contact: float
    path: list[Array] = field(default_factory=list)

    def __enter__(self) -> FatefulArm:
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def state(self) -> ArmState:
        self.fate.call(moves=False, kinds=FAULTS)
        return ArmState(self.joints, np.zeros(6), 0.0)

    def execute(self, motion: Trajectory, until_contact: bool, timeout_s: float) -> bool:
        assert np.abs(motion.joints[0] - self.joints).max() < 0.02
        self.fate.call(moves=True, kinds=FAULTS)
        touched = until_contact and bool(self.fate.rng.random() < self.contact)
        self.joints = motion.at(motion.duration * (self.fate.rng.uniform(0.05, 0.95) if touched else 1.0))
        self.path.append(self.joints)
        return touched

    def stop(self) -> None:
        pass


@dataclass
class FatefulGripper:
    """Holds something or not, by chance."""

    fate: Fate
    max_opening: float = 0.085
    at: float = 0.085

    def move(self, opening: float, force: float, timeout_s: float) -> float:
        self.fate.call(moves=True, kinds=(GripperFault, ConnectionLost, MotionTimeout))
        self.at = opening if opening > 0 else float(self.fate.rng.choice([0.0, 0.03]))
        return self.at

    def opening(self) -> float:
        return self.at

    def holds(self) -> bool:
        return self.at > 0.01 and bool(self.fate.rng.random() < 0.9)


@pytest.fixture(scope="module")
def plan() -> PickPlan:
    return MOTION.pick(CELL.out_of_sight, GRASP, CELL.drop, MOTION.checker())


@pytest.mark.parametrize("seeds", [60, pytest.param(SEEDS, marks=pytest.mark.slow)])
def test_faults_at_any_call(plan: PickPlan, monkeypatch: pytest.MonkeyPatch, seeds: int):
    """Of any kind, with and without contacts before; a fifth of the picks have none at all."""
    monkeypatch.setattr(type(MOTION), "pick", lambda *_: plan)
    # Ways in the open are straight here: the search itself is tested elsewhere.
    monkeypatch.setattr(type(MOTION), "way", straight)
    endings: dict[str, int] = {}
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        fate = Fate(rng, at=int(rng.integers(1, 30)) if seed % 5 else 10**6)
        arm = FatefulArm(fate, CELL.out_of_sight.copy(), contact=0.3)
        guarded = Guarded(arm, MOTION.fence)
        places = Places(CELL.out_of_sight, CELL.drop, 20.0)
        hand = ArmHand(guarded, FatefulGripper(fate), MOTION, places, rest=lambda: None)
        seen = Detection(Grasps.of([GRASP]), CELL.workspace, CELL.gripper.gripper)
        fault = None
        try:
            ending = pick(hand, hand.prepare(GRASP, seen), GRASP, 0.004, UP).reason
        except RobotError as error:
            fault, ending = error, type(error).__name__
        assert fault is fate.fault
        if fault is None:
            assert ending in (*REASONS, DROPPED)
            np.testing.assert_allclose(arm.joints, CELL.out_of_sight, atol=1e-6)
        else:
            with pytest.raises(type(fault)):
                guarded.execute(plan.way_in, until_contact=False, timeout_s=1e3)
        assert fate.moved_after == 0
        endings[ending] = endings.get(ending, 0) + 1
    assert {fault.__name__ for fault in (*FAULTS, GripperFault)} <= set(endings)
    assert {"success", "collision on the way", "nothing between the fingers"} <= set(endings)
    assert sum(endings.values()) == seeds


def straight(motion: arm_hand.Motion, start: Array, goals: Array, *_: object, **__: object) -> Trajectory:
    return motion.timed([np.linspace(start, goals[0], 30)])


def test_the_way_back_is_the_way_that_was_come(plan: PickPlan, monkeypatch: pytest.MonkeyPatch):
    """Where no way out is found after a contact, the arm goes back on its own track."""
    fate = Fate(np.random.default_rng(0), at=10**6)
    arm = FatefulArm(fate, CELL.out_of_sight.copy(), contact=1.0)
    places = Places(CELL.out_of_sight, CELL.drop, 20.0)
    hand = ArmHand(Guarded(arm, MOTION.fence), FatefulGripper(fate), MOTION, places, rest=lambda: None)
    seen = Detection(Grasps.of([GRASP]), CELL.workspace, CELL.gripper.gripper)
    hand.prepare(GRASP, seen)
    assert hand.move_to_pose(GRASP.pregrasp) is False
    stopped = arm.joints
    answers = iter((False, True))
    found = arm_hand.Motion.way

    def way(self: arm_hand.Motion, start: Array, goals: Array, *rest: object, **more: object) -> Trajectory:
        if not next(answers):
            raise NoPlan("none")
        return found(self, start, goals, *rest, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(arm_hand.Motion, "way", way)
    hand.retract()
    assert np.abs(stopped - CELL.out_of_sight).max() > 0.01
    np.testing.assert_allclose(arm.joints, CELL.out_of_sight, atol=1e-6)
