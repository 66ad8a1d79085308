"""Ways of an arm: to a pose, along a line, and everything that one grasp needs, checked before it begins."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from neugrasp.geometry.pose import Array, apply, inverse, rigid, rotation_about
from neugrasp.geometry.surface import Surface
from neugrasp.grasp import APPROACH, Grasp
from neugrasp.robot.collision import Carried, CollisionChecker, Surroundings
from neugrasp.robot.errors import InCollision, NoPlan, PlanningFailed, Unreachable
from neugrasp.robot.free_way import free_way
from neugrasp.robot.inverse import in_range, joints_of
from neugrasp.robot.limits import Fence
from neugrasp.robot.tool import Tool
from neugrasp.robot.trajectory import Pace, Trajectory, timed

LIFTS = (0.0, 0.05, 0.1, 0.15)
"""Metres straight up after the retreat, the first that brings what is held out of what stands around."""
LINE_STEP = 0.005
"""Metres between two positions on a line."""
LINE_TURN = 0.05
"""Radians of rotation between two positions on a line."""
JUMP = 0.35
"""Radians by which no joint may turn from one position on a line to the next: the arm would swing around."""
STANDOFFS = (APPROACH + 0.02, APPROACH + 0.04)
"""Metres before a grasp at which its straight way begins where the pre-grasp itself is not in the open."""
TRIES = 4
"""Ends that a way is sought to, the nearest first."""
TO_PREGRASP, TO_GRASP = "to the pre-grasp", "straight to the grasp"
BACK, TO_DROP, OUT_OF_SIGHT = "straight back from the grasp", "to the drop place", "out of sight"
"""What motions are for."""
HALF_TURN = rigid(rotation_about((0, 0, 1), np.pi))


@dataclass(frozen=True)
class PickPlan:
    """All motions of one grasp."""

    grasp: Grasp
    """As it is carried out: perhaps turned by pi about its approach, which is the same grasp, and as much
    deeper as open fingers are shorter (`Tool.standing`)."""
    carried: Carried
    """The hand after it, among what stands around."""
    way_in: Trajectory
    """From where the arm is to the pre-grasp."""
    approach: Trajectory
    """Straight to the grasp."""
    retreat: Trajectory
    """Straight back, and up until what is held is above what stands around."""
    way_out: Trajectory
    """To where the object is dropped."""


@dataclass(frozen=True)
class _Candidate:
    """One way to stand at a grasp."""

    grasp: Grasp
    approach: Array
    """(m, 6)"""
    retreat: Array
    """(k, 6)"""


@dataclass(frozen=True)
class Motion:
    """Plans the ways of one arm in one cell. Poses are `world_from_tcp`, joints (6,) radians."""

    fence: Fence
    tool: Tool
    approach_speed: float
    """m/s, on the way to a grasp."""
    timeout_s: float = 5.0
    """Longest time of one search for a way."""

    def checker(self, surface: Surface | None = None, clearance: float = 0.0) -> CollisionChecker:
        """What tells collisions, with what was seen on the table and how many metres are kept from it."""
        fence = self.fence
        around = Surroundings(fence.world_from_table, fence.limits.keep_out, surface, clearance)
        return CollisionChecker(fence.model, self.tool, fence.world_from_base, around)

    def tcp(self, joints: Array) -> Array:
        """`world_from_tcp` (..., 4, 4) of joints (..., 6)."""
        fence = self.fence
        pose: Array = fence.world_from_base @ fence.model.flange(joints) @ fence.flange_from_tcp
        return pose

    def solutions(self, world_from_tcp: Array, near: Array) -> Array:
        """Joints (n, 6) that bring the TCP to a pose, those nearest to `near` first."""
        fence = self.fence
        flange = inverse(fence.world_from_base) @ world_from_tcp @ inverse(fence.flange_from_tcp)
        found = in_range(fence.model, joints_of(fence.model, flange, wrist_3=float(near[5])), near)
        return found[np.argsort(np.abs(found - near).max(axis=1), kind="stable")]

    def way(
        self,
        start: Array,
        goals: Array,
        checker: CollisionChecker,
        grasping: bool = False,
        carried: Carried | None = None,
    ) -> Trajectory:
        """The way to the first of the goals (n, 6) that one is found to, with what is `carried`. Raises a
        `NoPlan`."""
        if not len(goals):
            raise Unreachable("no position of the joints brings the hand there")

        def is_free(joints: Array) -> bool:
            return self.fence.allows(joints) and checker.is_free(joints, grasping, carried)

        free = [goal for goal in goals if is_free(goal)]
        if not free:
            raise InCollision("the arm would touch something there")
        for goal in free[:TRIES]:
            try:
                legs = free_way(start, goal, self.fence.model, is_free, self.timeout_s)
            except PlanningFailed:
                continue
            return self.timed(legs)
        raise PlanningFailed("no way there was found")

    def timed(self, legs: list[Array], speed: float | None = None) -> Trajectory:
        """Legs (m, 6) as a motion, the TCP no faster than `speed`."""
        pace: Pace = self.fence.limits.pace
        if speed is not None:
            pace = replace(pace, tcp_speed=min(speed, pace.tcp_speed))
        return timed(legs, self.fence.model, self.fence.flange_from_tcp, pace)

    def line(self, start: Array, world_from_tcp: Array) -> Array:
        """Joints (m, 6) from `start` that lead the TCP along a line to a pose. Raises `Unreachable`."""
        here = self.tcp(start)
        shift = world_from_tcp[:3, 3] - here[:3, 3]
        ends = Rotation.from_matrix(np.stack([here[:3, :3], world_from_tcp[:3, :3]]))
        turn = float((ends[0].inv() * ends[1]).magnitude())
        steps = max(float(np.linalg.norm(shift)) / LINE_STEP, turn / LINE_TURN)
        count = max(2, int(np.ceil(steps)) + 1)
        between = Slerp([0, 1], ends)
        joints = [start]
        for part in np.linspace(0, 1, count)[1:]:
            pose = rigid(between(part).as_matrix(), here[:3, 3] + part * shift)
            near = self.solutions(pose, joints[-1])
            if not len(near) or np.abs(near[0] - joints[-1]).max() > JUMP:
                raise Unreachable("the arm cannot follow the straight line")
            joints.append(near[0])
        return np.stack(joints)

    def pick(
        self,
        start: Array,
        grasp: Grasp,
        drop: Array,
        checker: CollisionChecker,
        held: Array | None = None,
    ) -> PickPlan:
        """Everything that a grasp needs, from the joints `start` to the joints `drop`.

        `held` are corners (n, 3), in the user's world, around what comes along from the grasp on.

        Raises a `NoPlan` with the reason, or a `Refused` where the fence does not let the hand there.
        """
        fingers = self.tool.fingers_at(min(grasp.width, self.tool.gripper.max_opening))
        grasp = self.tool.standing(grasp)
        for pose in (grasp.pose, grasp.pregrasp, grasp.retreat):
            self.fence.check_pose(pose)
        problem: NoPlan = Unreachable("the arm does not reach the grasp in a straight line")
        ways = 0
        for followed in self._followed(start, grasp):
            carried = checker.carrying(fingers, self._in_flange(followed.approach[-1], held))
            candidate = self._begun_in_the_open(followed, checker)
            if candidate is None or not self._is_free(candidate, checker, carried):
                if ways == 0:
                    problem = InCollision("arm, hand or camera would touch something on the line to it")
                continue
            ways += 1
            out = checker.lifted(carried, held)
            try:
                way_in = self.way(start, candidate.approach[:1], checker)
                lift = self._lift(candidate, checker, carried, out)
                way_out = self.way(lift[-1], drop[None], checker, True, out)
            except NoPlan as error:
                problem = PlanningFailed(f"{error}, on the way to the grasp or out again")
                if ways == TRIES:
                    break
                continue
            approach = self.timed([candidate.approach], self.approach_speed)
            retreat = self.timed([candidate.retreat, lift], self.approach_speed)
            return PickPlan(
                candidate.grasp,
                carried,
                way_in.named(TO_PREGRASP),
                approach.named(TO_GRASP),
                retreat.named(BACK),
                way_out.named(TO_DROP),
            )
        raise problem

    def _followed(self, start: Array, grasp: Grasp) -> Iterator[_Candidate]:
        """All ways to stand there from which the lines can be followed, the nearest pre-grasp first."""
        turned = (grasp, replace(grasp, pose=grasp.pose @ HALF_TURN))
        stands = [(g, joints) for g in turned for joints in self.solutions(g.pregrasp, start)]
        for same, pregrasp in sorted(stands, key=lambda stand: float(np.abs(stand[1] - start).max())):
            try:
                approach = self.line(pregrasp, same.pose)
                yield _Candidate(same, approach, self.line(approach[-1], same.retreat))
            except Unreachable:
                continue

    def _lift(
        self, candidate: _Candidate, checker: CollisionChecker, carried: Carried, out: Carried
    ) -> Array:
        """Joints (m, 6) straight up from the retreat to where what is carried is `out` of what stands around.
        Raises a `NoPlan`."""
        pose, up = candidate.grasp.retreat, np.array(candidate.grasp.up)
        for height in LIFTS:
            lift = self.line(candidate.retreat[-1], rigid(pose[:3, :3], pose[:3, 3] + height * up))
            if checker.is_free(lift[-1], True, out) and all(
                checker.is_free(at, True, carried) for at in lift
            ):
                return lift
        raise InCollision("what is held would touch what stands around it")

    def _begun_in_the_open(self, candidate: _Candidate, checker: CollisionChecker) -> _Candidate | None:
        """The same, its straight way begun farther back where the pre-grasp is too near to what was seen:
        open fingers beside something tall and wide. None where the arm is not free there either."""
        pregrasp = candidate.approach[0]
        if checker.is_free(pregrasp):
            return candidate
        for distance in STANDOFFS:
            try:
                back = self.line(pregrasp, candidate.grasp.advanced(-distance).pose)
            except Unreachable:
                return None
            if checker.is_free(back[-1]):
                return replace(candidate, approach=np.concatenate([back[:0:-1], candidate.approach]))
        return None

    def _in_flange(self, joints: Array, points: Array | None) -> Array | None:
        """Points (n, 3) of the world as the flange sees them with the joints at (6,)."""
        if points is None:
            return None
        fence = self.fence
        return np.asarray(apply(inverse(fence.world_from_base @ fence.model.flange(joints)), points))

    def _is_free(self, candidate: _Candidate, checker: CollisionChecker, carried: Carried) -> bool:
        """The ends first: what is in the way is found early."""
        return all(checker.is_free(joints, grasping=True) for joints in candidate.approach[::-1]) and all(
            checker.is_free(joints, True, carried) for joints in candidate.retreat[::-1]
        )
