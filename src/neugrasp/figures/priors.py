"""Surface and grasps with photos of the empty table and without: the paper's Fig. 5, for what they give."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.figures.figure_inputs import FigureInput
from neugrasp.gripper import Gripper
from neugrasp.metrics import l1_by_mask
from neugrasp.observation import Image, View, Views
from neugrasp.pictures import (
    Tile,
    contact_sheet,
    draw_grasps,
    free_where_unseen,
    opposite,
    photo_of_workspace,
    shade_surface,
)

SIZE = 320
"""Pixels of the longer side of a picture."""
DRAWN = 5
"""Grasps drawn into a photo; more hide the objects."""
MASK = "0.3"
"""Mask of the L1 in the captions: the headline of the benchmark."""


@dataclass(frozen=True)
class Variant:
    """One column of the figure."""

    words: str
    """What the model had for a background."""
    detection: Detection


def priors_figure(source: FigureInput, detector: NeuGraspDetector, other: NeuGraspDetector | None) -> Image:
    """The photo with the best grasps above the surface from two sides, a column for each variant; in the
    first column the truth, where it is known.

    `other` is a model that was trained without backgrounds. Without it, the second and third column show the
    same model with its backgrounds taken away, which it never was in training.
    """
    front = photo_of_workspace(source.view, source.views.workspace, SIZE)
    back = opposite(front, source.views.workspace)
    columns = [_given(source, front, back)]
    for variant in variants(source.views, detector, other):
        columns.append(_column(variant, source, (front, back), detector.gripper))
    tiles = [column[row] for row in range(3) for column in columns]
    title = (
        "With and without backgrounds: the same weights, their background taken away (not trained so)"
        if other is None
        else "With and without backgrounds: two models, each as it was trained"
    )
    return contact_sheet(tiles, columns=len(columns), title=title)


def variants(views: Views, detector: NeuGraspDetector, other: NeuGraspDetector | None) -> list[Variant]:
    """What is found with backgrounds, and without. Raises `InputError` where a model cannot play its part."""
    if not detector.model.config.use_backgrounds:
        raise InputError("--weights: this model was trained without backgrounds; give it as --without")
    found = [Variant("with the empty table", detector.detect(views))]
    if other is None:
        for words, change in TAKEN_AWAY.items():
            found.append(Variant(words, detector.detect(replace_backgrounds(views, change))))
        return found
    if other.model.config.use_backgrounds:
        raise InputError("--without: this model was trained with backgrounds; one trained without is wanted")
    return [*found, Variant("trained without the empty table", other.detect(views))]


def itself(view: View) -> Image:
    """The photo as its own background: nothing seems to have been put down."""
    return view.image


def one_colour(view: View) -> Image:
    """The photo's mean colour: everything seems to have changed."""
    mean = view.image.reshape(-1, 3).mean(axis=0).round().astype(np.uint8)
    return np.broadcast_to(mean, view.image.shape).copy()


TAKEN_AWAY: dict[str, Callable[[View], Image]] = {
    "photo as its own background": itself,
    "one colour as background": one_colour,
}
"""The two ways to take the background from a model that wants one."""


def replace_backgrounds(views: Views, change: Callable[[View], Image]) -> Views:
    """The same photos with other backgrounds."""
    changed = tuple(replace(view, background=change(view)) for view in views.frames)
    return replace(views, frames=changed)


def _given(source: FigureInput, front: View, back: View) -> list[Tile]:
    """The first column: the photo, and the truth or the empty table."""
    photo = Tile(front.image, f"{source.name}, photo {source.index}")
    if source.truth is None:
        blank = np.full_like(back.image, 255)
        return [photo, Tile(front.background, "empty table"), Tile(blank, "")]
    grid, workspace = free_where_unseen(source.truth.tsdf), source.views.workspace
    return [
        photo,
        Tile(shade_surface(grid, workspace, front.camera, SIZE), "true surface"),
        Tile(shade_surface(grid, workspace, back.camera, SIZE), "true surface, other side"),
    ]


def _column(variant: Variant, source: FigureInput, sides: tuple[View, View], gripper: Gripper) -> list[Tile]:
    """What one variant found, from above: grasps, surface, surface from the other side."""
    detection, workspace = variant.detection, source.views.workspace
    front, back = (shade_surface(detection.grid(), workspace, side.camera, SIZE) for side in sides)
    count = len(detection.grasps)
    found = (
        f"{count} grasp{'s' * (count > 1)}, best {detection.grasps[0].score:.2f}" if count else "no grasps"
    )
    error = ""
    if source.truth is not None:
        error = f"L1 {l1_by_mask(detection.grid(), source.truth.tsdf)[MASK]:.3f}"
    return [
        Tile(draw_grasps(sides[0], detection.grasps[:DRAWN], gripper, 1), variant.words),
        Tile(front, found),
        Tile(back, error),
    ]
