"""What the person in front of the viewer has chosen."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from neugrasp.detection.options import Box
from neugrasp.pictures.slices import busiest_slice
from neugrasp.viewer.scene_data import GraspMarker, SceneData

Colouring = Literal["photos", "confidence", "views", "plain"]
Hand = Literal["whole hand", "fingers", "lines"]
COLOURINGS: tuple[Colouring, ...] = ("photos", "confidence", "views", "plain")
HANDS: tuple[Hand, ...] = ("fingers", "whole hand", "lines")
AXES = ("none", "x", "y", "z")
"""Axes along which a slice is looked at."""


@dataclass(frozen=True)
class Settings:
    """One state of the controls."""

    moment: int = 0
    shows_cameras: bool = True
    shows_cube: bool = True
    shows_table: bool = True
    shows_surface: bool = True
    shows_reconstructed_table: bool = False
    """Whether the part of the surface that is the table is drawn, too."""
    shows_truth: bool = False
    shows_true_grasps: bool = False
    colouring: Colouring = "photos"
    threshold: float = 0.0
    """Grasps of a lower score are not drawn."""
    most: int = 5
    """How many grasps are drawn, the best ones."""
    hand: Hand = "fingers"
    slice_axis: str = "none"
    slice_index: int = 0
    region: Box | None = None
    """Box of the world outside of which grasps are not drawn; that of an object that was chosen."""
    selected: GraspMarker | None = None
    """The grasp that was clicked."""

    def suited_to(self, data: SceneData) -> Settings:
        """The state to begin with: colours that there can be, and the slice that cuts most matter.

        Raises `InputError` where there is no such moment.
        """
        tsdf = data.moment(self.moment).tsdf
        needs_photos = self.colouring in ("photos", "views")
        index = data.workspace.resolution // 2
        return replace(
            self,
            colouring="plain" if needs_photos and not data.photos else self.colouring,
            slice_index=index if tsdf is None else busiest_slice(tsdf, data.workspace),
        )


def scores(data: SceneData) -> np.ndarray:
    """The scores of all predicted grasps of all moments."""
    return np.array([c.grasp.score for moment in data.moments for c in moment.grasps])


def most_grasps(data: SceneData) -> int:
    """The greatest number of grasps that there are to draw at once."""
    return max(len(data.truth.grasps), *(len(moment.grasps) for moment in data.moments))
