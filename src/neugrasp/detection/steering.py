"""Which of the detected grasps are wanted: where, from which side, how many."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from neugrasp.errors import InputError

if TYPE_CHECKING:
    from neugrasp.detection.detector import Detection
    from neugrasp.geometry.workspace import Workspace
    from neugrasp.grasp import Grasp
    from neugrasp.views import Views

Box = tuple[float, float, float, float, float, float]
Cone = tuple[float, float, float, float]
Grasps = tuple["Grasp", ...]


@dataclass(frozen=True, kw_only=True)
class Steering:
    """What a grasp must satisfy besides; everything in the world of the scene."""

    region: Box | None = None
    """Box in which the point between the fingertips must lie: x, y and z from, x, y and z to, metres."""
    mask: tuple[int, Path] | None = None
    """Number of a view and a picture of its photo's size: the point between the fingertips must be seen where
    that is brighter than half."""
    approach: Cone | None = None
    """Direction x, y, z in which the hand may move to the grasp, and by how many degrees it may deviate:
    0 0 -1 30 is from above."""
    min_height: float | None = None
    """Least height of the point between the fingertips above the table, metres."""
    one_object: bool = False
    """Only grasps of one object, that of the best grasp which is left: one object at a time. What touches is
    one object here."""
    top: int | None = None
    """So many grasps at most, the best."""

    def __post_init__(self) -> None:
        if self.region is not None and not all(self.region[i] < self.region[i + 3] for i in range(3)):
            raise InputError(f"--region {_words(self.region)}: give the lower corner, then the upper one")
        if self.approach is not None:
            *direction, degrees = self.approach
            if not 0 < float(np.linalg.norm(direction)) < np.inf or not 0 < degrees <= 180:
                raise InputError(
                    f"--approach {_words(self.approach)}: a direction that is not 0, then 0 to 180 degrees"
                )
        if self.top is not None and self.top < 1:
            raise InputError(f"--top {self.top}: must be at least 1")

    def applied(self, detection: Detection, workspace: Workspace, views: Views | None = None) -> Detection:
        """The detection with the wanted grasps alone, the others counted by reason.

        A mask needs the `views`. Raises `InputError` where it does not belong to one of them.
        """
        is_masked = self._masked(views)
        kept, rejected = detection.grasps, dict(detection.rejected)
        rules: dict[str, Callable[[Grasps], Grasps]] = {
            "outside_the_region": lambda grasps: tuple(filter(self._is_inside, grasps)),
            "outside_the_mask": lambda grasps: tuple(filter(is_masked, grasps)),
            "from_another_side": lambda grasps: tuple(filter(self._is_approached, grasps)),
            "too_low": lambda grasps: tuple(one for one in grasps if self._is_high(one, workspace)),
            "on_another_object": lambda grasps: self._on_one(grasps, detection, workspace),
            "beyond_the_best": lambda grasps: grasps[: self.top],
        }
        for reason, wanted in rules.items():
            left = wanted(kept)
            if len(left) < len(kept):
                rejected[reason] = len(kept) - len(left)
            kept = left
        return replace(detection, grasps=kept, rejected=rejected)

    def _on_one(self, grasps: Grasps, detection: Detection, workspace: Workspace) -> Grasps:
        """Those of the object that the best one is at."""
        if not self.one_object or len(grasps) < 2:
            return grasps
        # With SciPy, which would make every command slow to start.
        from neugrasp.detection.things import nearest, things_in

        things = things_in(detection.tsdf, workspace)
        at = [nearest(things, grasp.position, workspace) for grasp in grasps]
        return tuple(grasp for grasp, thing in zip(grasps, at, strict=True) if thing == at[0])

    def check(self, views: Views) -> None:
        """Raises `InputError` where the mask does not belong to one of the views."""
        self._masked(views)

    def _masked(self, views: Views | None) -> Callable[[Grasp], bool]:
        """Whether a grasp is seen where the mask is bright."""
        if self.mask is None:
            return lambda _: True
        number, file = self.mask
        if views is None or not 0 <= number < len(views):
            count = 0 if views is None else len(views)
            raise InputError(f"--mask {number} {file}: there are views 0 to {count - 1}")
        # With Pillow, as above.
        from neugrasp.data.photo_files import read_image

        bright, camera = read_image(file, "--mask").max(axis=2) > 127, views.views[number].camera
        if bright.shape != (camera.height, camera.width):
            raise InputError(
                f"--mask {number} {file}: {bright.shape[1]} x {bright.shape[0]} pixels; photo {number} has "
                f"{camera.width} x {camera.height}"
            )

        def is_masked(grasp: Grasp) -> bool:
            (column, row), depth = camera.project(grasp.position)
            column, row = round(float(column)), round(float(row))
            inside = depth > 0 and 0 <= row < bright.shape[0] and 0 <= column < bright.shape[1]
            return bool(inside and bright[row, column])

        return is_masked

    def _is_inside(self, grasp: Grasp) -> bool:
        if self.region is None:
            return True
        low, high = np.array(self.region[:3]), np.array(self.region[3:])
        return bool(np.all((grasp.position >= low) & (grasp.position <= high)))

    def _is_approached(self, grasp: Grasp) -> bool:
        if self.approach is None:
            return True
        *direction, degrees = self.approach
        cosine = grasp.approach @ np.array(direction) / np.linalg.norm(direction)
        return bool(np.degrees(np.arccos(np.clip(cosine, -1, 1))) <= degrees + 1e-9)

    def _is_high(self, grasp: Grasp, workspace: Workspace) -> bool:
        if self.min_height is None:
            return True
        up, origin = workspace.world_from_workspace[:3, 2], workspace.world_from_workspace[:3, 3]
        return bool((grasp.position - origin) @ up - workspace.table_height >= self.min_height)


def _words(numbers: tuple[float, ...]) -> str:
    return " ".join(f"{number:g}" for number in numbers)
