"""Bodies that cannot move for a while.

What moves shares one system of equations with all that its bounding box overlaps, and the engine iterates on
it as long as its slowest part needs: a resting pile costs as much in every step as what happens in the hand.
A frozen body costs nothing until something touches it, and as long as nothing does, all else goes as if it
could move.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import hypot
from typing import Any

BodyPose = tuple[tuple[float, ...], tuple[float, ...]]
"""Position and quaternion of the engine's body, whose origin is the centre of mass."""


class Freezer:
    """Freezes bodies where they are. They count from 0 as in the world; none may come or go meanwhile."""

    def __init__(self, client: Any, uids: Sequence[int]):
        self._client, self._uids = client, uids
        self._masses = [client.getDynamicsInfo(uid, -1)[0] for uid in uids]
        self._everything = frozenset(range(len(uids)))
        self._free = self._everything

    def free(self, bodies: frozenset[int]) -> None:
        """Lets these bodies move, and no others. Contacts are out of date afterwards: restore a state."""
        # Without mass, a body is immovable. All are frozen first, so that the engine meets the free ones in
        # the same order whatever was free before: the order of contacts tells in the last bits.
        for i in self._free:
            self._client.changeDynamics(self._uids[i], -1, mass=0)
        for i in sorted(bodies):
            self._client.changeDynamics(self._uids[i], -1, mass=self._masses[i])
        self._free = bodies

    def free_all(self) -> None:
        """Lets all bodies move."""
        self.free(self._everything)

    def touched(self) -> frozenset[int]:
        """The frozen bodies that something touched when collisions were last computed."""
        contacts = self._client.getContactPoints
        return frozenset(i for i in self._everything - self._free if contacts(self._uids[i]))

    def groups(self) -> list[frozenset[int]]:
        """For each body, all that hang together with it by contacts; none may be frozen."""
        contacts = self._client.getContactPoints
        groups = [frozenset([i]) for i in self._everything]
        for i, first in enumerate(self._uids):
            for j, second in enumerate(self._uids[:i]):
                if j not in groups[i] and contacts(first, second):
                    joined = groups[i] | groups[j]
                    groups = [joined if k in joined else group for k, group in enumerate(groups)]
        return groups

    def poses(self) -> list[BodyPose]:
        """Where the bodies are."""
        return [self._client.getBasePositionAndOrientation(uid) for uid in self._uids]

    def speeds(self, lever: float) -> list[float]:
        """How fast the free bodies are, m/s; a turn counts at the end of a lever, metres."""
        velocities = [self._client.getBaseVelocity(self._uids[i]) for i in self._free]
        return [hypot(*linear, *(lever * rate for rate in angular)) for linear, angular in velocities]

    def put(self, poses: Sequence[BodyPose]) -> None:
        """Puts the bodies somewhere."""
        for uid, pose in zip(self._uids, poses, strict=True):
            self._client.resetBasePositionAndOrientation(uid, *pose)
