"""What the person in front of the viewer has chosen."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from neugrasp.pictures.slices import busiest_slice
from neugrasp.viewer.contents import Contents

Colouring = Literal["photos", "confidence", "views", "plain"]
Hand = Literal["whole hand", "fingers", "lines"]
COLOURINGS: tuple[Colouring, ...] = ("photos", "confidence", "views", "plain")
HANDS: tuple[Hand, ...] = ("whole hand", "fingers", "lines")
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
    most: int = 3
    """How many grasps are drawn, the best ones."""
    hand: Hand = "whole hand"
    slice_axis: str = "none"
    slice_index: int = 0
    selected: int | None = None
    """The number of the grasp that was clicked."""

    @classmethod
    def for_contents(
        cls, contents: Contents, colouring: Colouring = "photos", shows_truth: bool = False, moment: int = 0
    ) -> Settings:
        """The state to begin with. Raises `InputError` where there is no such moment."""
        tsdf = contents.moment(moment).tsdf
        return cls(
            moment=moment,
            colouring=colouring if contents.has_photos or colouring == "confidence" else "plain",
            shows_truth=shows_truth,
            slice_index=contents.workspace.resolution // 2
            if tsdf is None
            else busiest_slice(tsdf, contents.workspace),
        )


def scores(contents: Contents) -> np.ndarray:
    """The scores of all grasps of all moments."""
    return np.array([c.grasp.score for moment in contents.moments for c in moment.grasps])
