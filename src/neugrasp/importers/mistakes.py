"""What is wrong with poses that do not fit: the common mistakes in the file that the user has."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence

import numpy as np

from neugrasp.data.camera_checks import is_plausible
from neugrasp.data.photo_files import read_image
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, inverse, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.alignment import align
from neugrasp.importers.photos import Pair
from neugrasp.importers.posed_image import PosedImage
from neugrasp.importers.table_agreement import TablePhoto, agreement, table_points

TOOLS = np.arange(0.02, 0.3001, 0.0025)
"""Metres from a flange to the tip of a tool."""
DOUBTFUL, CONVINCING = 0.6, 0.8
"""Agreement about the table below which poses are doubted, and above which a mistake, undone, is believed."""
CLEAR = 0.25
"""By how much they must agree better."""

Mistake = tuple[str, list[Array]]
"""Its name, and world_from_camera of all posed images once it is undone."""
Agreement = Callable[[list[Array]], float | None]
"""How well the photos of the table agree for some poses."""


def check_poses(
    posed_images: Sequence[PosedImage], pairs: Mapping[str, Pair], workspace: Workspace, where: str
) -> None:
    """Raises `InputError` where most cameras do not look down at the cube, or where the photos of the empty
    table contradict each other, and one of the common mistakes, undone, would mend that.

    Where no mistake is known, what is said of the scene later has to do; a table without a pattern tells
    nothing.
    """
    still = [posed for posed in posed_images if posed.world_from_background is None]
    agree = _agreement(still, pairs, workspace)
    if (
        sum(_plausible(posed_images, [posed.world_from_camera for posed in posed_images], workspace))
        <= len(posed_images) / 2
    ):
        usual, rare = (
            [one for one in some if all(_plausible(posed_images, one[1], workspace))]
            for some in (_mistakes(posed_images), _rare_mistakes(posed_images))
        )
        likely = [name for name, poses in (*usual, *rare) if (agree(poses) or 0.0) > CONVINCING]
        cube_from_world = inverse(workspace.world_from_workspace)
        heights = [(cube_from_world @ posed.world_from_camera)[2, 3] for posed in posed_images]
        if not likely and max(heights) < workspace.table_height:
            raise InputError(
                f"{where}: all cameras lie below the table of the cube; the z axis of world_from_workspace "
                "must point up, away from the table" + "".join(f"; or: {name}" for name, _ in usual)
            )
        if likely or usual:
            text = "; or: ".join(likely or [name for name, _ in usual])
            raise InputError(f"{where}: the cameras do not look down at the workspace; {text}")
        return
    # Poses so wrong that no two photos share a part of the table agree about nothing.
    given = agree([posed.world_from_camera for posed in still]) or 0.0
    if given >= DOUBTFUL:
        return
    tried = [
        (agree(poses) or 0.0, name)
        for name, poses in (*_mistakes(still), *_rare_mistakes(still), *_tools(still))
        if all(_plausible(still, poses, workspace))
    ]
    # Of those that fit alike the likeliest, which comes first.
    best, name = max(tried, default=(0.0, ""), key=lambda one: round(one[0], 4))
    if best > CONVINCING and best > given + CLEAR:
        raise InputError(
            f"{where}: the photos of the table agree by {given:.2f} of 1 only, and by {best:.2f} once one "
            f"mistake is undone: {name}"
        )


def explained(
    error: str, posed_images: Sequence[PosedImage], world_from_camera: Sequence[Array], has_unit: bool
) -> str:
    """The error of an alignment with the mistake, undone, that makes it fit best."""
    fitting = []
    for name, poses in (*_mistakes(posed_images), *(_tools(posed_images) if has_unit else ())):
        try:
            fitting.append((align(poses, world_from_camera, has_unit).residual, name))
        except InputError:
            continue
    if not fitting:
        return error
    _, name = min(fitting)
    return f"{error} {name[0].upper()}{name[1:]}"


def _plausible(
    posed_images: Sequence[PosedImage], poses: Sequence[Array], workspace: Workspace
) -> list[bool]:
    return [
        is_plausible(Camera(posed.lens.intrinsics, pose, posed.lens.width, posed.lens.height), workspace)
        for posed, pose in zip(posed_images, poses, strict=True)
    ]


def _agreement(
    posed_images: Sequence[PosedImage], pairs: Mapping[str, Pair], workspace: Workspace
) -> Agreement:
    """Agreement of the backgrounds of the posed images, which are read when they are asked for."""
    photos: list[TablePhoto] = []
    points = table_points(workspace)

    def agree(poses: list[Array]) -> float | None:
        if len(poses) != len(posed_images) or len(poses) < 2:
            return None
        if not photos:
            photos.extend(
                TablePhoto.of(read_image(pairs[posed.name].background, posed.name), posed.lens)
                for posed in posed_images
            )
        return agreement(photos, poses, points)

    return agree


def _mistakes(posed_images: Sequence[PosedImage]) -> Iterator[Mistake]:
    """Those that all of the posed images could have."""
    return _of_all([posed.suspects for posed in posed_images])


def _rare_mistakes(posed_images: Sequence[PosedImage]) -> Iterator[Mistake]:
    return _of_all([posed.rare_suspects for posed in posed_images])


def _of_all(suspects: Sequence[Mapping[str, Array]]) -> Iterator[Mistake]:
    for name in suspects[0] if suspects else ():
        if all(name in some for some in suspects):
            yield name, [some[name] for some in suspects]


def _tools(posed_images: Sequence[PosedImage]) -> Iterator[Mistake]:
    """The poses of a tool's tip given for those of the flange, for tools of many lengths."""
    axes = [posed.flange_axis for posed in posed_images if posed.flange_axis is not None]
    if len(axes) < len(posed_images):
        return
    for length in TOOLS:
        yield (
            f"base_from_flange looks like the pose of a tool's tip (TCP), {1000 * length:.0f} mm beyond the "
            "flange: give the pose of the flange itself",
            [
                rigid(posed.world_from_camera[:3, :3], posed.world_from_camera[:3, 3] - length * axis)
                for posed, axis in zip(posed_images, axes, strict=True)
            ],
        )
