"""What a flange carries: gripper and camera, as convex parts."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neugrasp.geometry.pose import Array, apply
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper


@dataclass(frozen=True)
class Tool:
    """What the flange carries, as corners of convex parts in the flange's frame, metres."""

    palm: tuple[Array, ...]
    fingers: tuple[Array, ...]
    """Open as far as they go, unless it is said otherwise."""
    camera: tuple[Array, ...]
    gripper: Gripper
    flange_from_hand: Array

    @classmethod
    def of(cls, gripper: Gripper, flange_from_hand: Array, camera: Sequence[Array] = ()) -> Tool:
        """A gripper mounted at a pose, with its fingers open, and a camera beside it."""
        fingers = _fingers(gripper, flange_from_hand, gripper.max_opening)
        palm = tuple(_moved(flange_from_hand, hull) for hull in gripper.palm.hulls)
        return cls(palm, fingers, tuple(camera), gripper, flange_from_hand)

    def fingers_at(self, opening: float) -> tuple[Array, ...]:
        """The fingers with their pads `opening` metres apart."""
        return _fingers(self.gripper, self.flange_from_hand, opening)

    def standing(self, grasp: Grasp) -> Grasp:
        """Where the hand has to stand for a grasp: as much deeper as its fingers are shorter than closed
        ones."""
        return grasp.advanced(self._setback(grasp.width))

    def reached(self, standing: Grasp) -> Grasp:
        """The reverse of `standing`: the grasp at the pads of a hand that stands somewhere."""
        return standing.advanced(-self._setback(standing.width))

    def _setback(self, width: float) -> float:
        return float(self.gripper.tip_setback(min(width, self.gripper.max_opening)))


def _fingers(gripper: Gripper, flange_from_hand: Array, opening: float) -> tuple[Array, ...]:
    hulls = gripper.finger_hulls(opening, float(gripper.tip_setback(opening)))
    return tuple(_moved(flange_from_hand, hull) for hull in hulls)


def _moved(flange_from_hand: Array, points: Array) -> Array:
    return np.asarray(apply(flange_from_hand, points))
