"""Many grasps tried from one settled scene: the outcomes of `execute` at a fraction of its time.

One gripper serves all trials. Collisions on the way to a grasp are found by geometry alone. Bodies that have
nothing to do with a grasp are frozen. Closing ends when all is calm, carrying when one body is firmly in hand
and its way is free. `benchmarks/label_speed.py` compares all this with `execute`.
"""

from __future__ import annotations

from dataclasses import dataclass

from scipy.spatial.transform import Rotation

from neugrasp.execution import AT_PREGRASP, ON_APPROACH
from neugrasp.geometry.pose import Array
from neugrasp.grasp import APPROACH, Grasp
from neugrasp.simulation.body_freezing import BodyPose, Freezer
from neugrasp.simulation.grasp_execution import Trial, WorldHand, end_of_retreat, failure, min_opening
from neugrasp.simulation.hand import STEPS_PER_MOVE
from neugrasp.simulation.physics import World

CLOSED_CALM, CARRIED_CALM = 2e-3, 1e-3
"""Speeds in m/s below which things are calm: all that can move while the hand closes, and what it carries,
relative to the hand. At the second, 0.8 mm would pass until the retreat ends."""
CALM_LOOKS = 3
"""So many looks in a row, 1/60 s apart, must find them calm."""
LEVER = 0.05
"""Metres at which a turn counts as a speed."""


def execute_each(world: World, poses: Array, rule: str = "paper") -> list[Trial]:
    """What comes of a grasp at each of the TCP poses (n, 4, 4); the world is afterwards as it was before.

    A contact on the approach is a failure, as in `execute` without `allow_contact`; and as there, the scene
    has rested for the time of an approach when the fingers close. What comes of a grasp does not depend on
    the others. Raises `InputError` on an unknown rule.
    """
    least = min_opening(world, rule)
    if not len(poses):
        return []
    world.hand()
    before = world.save()
    freezer = world.freezer()
    course = _course(world, freezer)
    scene = _Scene(world, freezer, world.save(), freezer.groups(), least)
    freezer.free(frozenset())
    reasons = foreseen(world, freezer, poses, course)
    grasps = [Grasp(pose, world.gripper.max_opening) for pose in poses]
    trials = [
        scene.tried(grasp) if reason is None else failure(world, reason)
        for grasp, reason in zip(grasps, reasons, strict=True)
    ]
    freezer.free_all()
    world.restore(before)
    world.forget(before)
    world.forget(scene.settled)
    return trials


def _course(world: World, freezer: Freezer) -> list[list[BodyPose]]:
    """Where all bodies are at each look of `execute` for contacts, as long as nothing touches them.

    A settled scene still creeps, and a ball may roll by millimetres. The time of an approach passes.
    """
    course = [freezer.poses()]
    for _ in world.approach:
        # The engine looks for contacts at the beginning of the last step of a move.
        world.step(STEPS_PER_MOVE - 1)
        course.append(freezer.poses())
        world.step()
    return course


def foreseen(world: World, freezer: Freezer, poses: Array, course: list[list[BodyPose]]) -> list[str | None]:
    """The collisions with which `execute` of TCP poses (n, 4, 4) without `allow_contact` must end, found by
    geometry alone; None where there is none. All bodies must be frozen.

    The hand follows its targets on a straight line and a known lag behind, so the places where `execute`
    looks for contacts are known, and nothing else happens before the first contact. No time passes here.
    """
    hand = world.hand()
    hand.park()
    reasons: list[str | None] = [None] * len(poses)
    quaternions = Rotation.from_matrix(poses[:, :3, :3]).as_quat().tolist()
    short = (APPROACH, *world.approach)
    # The pre-grasp comes first, and then the end: most collisions are there.
    for look in (0, *range(len(short) - 1, 0, -1)):
        freezer.put(course[look])
        positions = (hand.body_positions(poses) - short[look] * poses[:, :3, 2]).tolist()
        for k, position in enumerate(positions):
            if reasons[k] is None:
                hand.show(position, quaternions[k])
                world.detect_collisions()
                if hand.touches():
                    reasons[k] = ON_APPROACH if look else AT_PREGRASP
    return reasons


@dataclass(frozen=True)
class _Scene:
    """A settled scene in which grasps are tried whose approach is free."""

    world: World
    freezer: Freezer
    settled: int
    """The saved state from which every trial starts."""
    groups: list[frozenset[int]]
    """For each body, those with which it hangs together."""
    min_opening: float
    """Metres that must remain between the pads."""

    def tried(self, grasp: Grasp) -> Trial:
        """A trial in which only those bodies can move that something touches.

        Where something touches a frozen body, it is all done again with that one's group free to move. In the
        end nothing has touched what could not move.
        """
        free: frozenset[int] = frozenset()
        self.freezer.free(free)
        self.world.restore(self.settled)
        arrival = self.world.hand().approached(grasp.pose)
        while True:
            self.freezer.free(free)
            self.world.restore(self.settled)
            self.world.hand().resume(arrival)
            watch = _Watch(self.world, self.freezer, end_of_retreat(grasp))
            hand = WorldHand(self.world, self.min_opening, watch.sees_closed, watch.sees_carried)
            trial = hand.lift(grasp)
            touched = self.freezer.touched()
            if not touched:
                return trial
            free = free.union(*(self.groups[i] for i in touched))


@dataclass
class _Calm:
    """Counts how often in a row all was calm."""

    looks: int = 0

    def lasts(self, is_calm: bool) -> bool:
        """Whether it has been calm for long enough, this look included."""
        self.looks = self.looks + 1 if is_calm else 0
        return self.looks >= CALM_LOOKS


class _Watch:
    """Tells when a trial need not go on."""

    def __init__(self, world: World, freezer: Freezer, goal: Array):
        self._hand, self._freezer, self._goal = world.hand(), freezer, goal
        self._closed, self._carried = _Calm(), _Calm()
        self._is_blocked = False

    def sees_closed(self) -> bool:
        """Whether closing can end: all is calm, or a frozen body is touched and the trial is void."""
        if self._freezer.touched():
            return True
        speeds = (*self._freezer.speeds(LEVER), *self._hand.finger_speeds())
        return self._closed.lasts(max(speeds) < CLOSED_CALM)

    def sees_carried(self) -> bool:
        """Whether carrying can end: one body is firmly in hand and its way free, or the trial is void."""
        if self._freezer.touched():
            return True
        held = None if self._is_blocked else self._hand.holds()
        is_calm = held is not None and self._hand.slip(held, LEVER) < CARRIED_CALM
        if not self._carried.lasts(is_calm) or held is None:
            return False
        self._is_blocked = not self._hand.can_carry(held, self._goal)
        return not self._is_blocked
