"""What every importer gives: the name of a photo, its lens and its pose. Paired with backgrounds, a scene."""

from __future__ import annotations

import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from neugrasp.data.photo_files import OTHER_FOCAL, photo_tags, read_image
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.lens import Lens
from neugrasp.geometry.pose import Array, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.importers.photos import Pair, shortened
from neugrasp.importers.resampling import (
    full_rectangle,
    is_in_place,
    is_inside,
    resampled,
    seen_on_table,
)
from neugrasp.observation import MAX_VIEWS, Image, View, Views

LEAST_SHOWN = 0.2
"""Share of a photo that must be left after undistorting and warping."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PosedImage:
    """A photo with its camera, as another program knows it."""

    name: str
    """Path relative to the folder of the photos."""
    lens: Lens
    world_from_camera: Array
    """4x4, OpenCV axes; its translation in the other program's unit until `placed`."""
    world_from_background: Array | None = None
    """Pose of the camera that took the background, where it was not at the same place."""
    suspects: Mapping[str, Array] = field(default_factory=dict)
    """world_from_camera if one of the common mistakes was made in the other program's file, by its name."""
    flange_axis: Array | None = None
    """(3,) where the flange that holds the camera points, in the world; None without a robot."""
    rare_suspects: Mapping[str, Array] = field(default_factory=dict)
    """As `suspects`, of rarer mistakes: believed only where the photos of the table confirm them."""

    def placed(self, new_from_world: Array, metres_per_unit: float = 1.0) -> PosedImage:
        """The same image in metres and in another frame; `new_from_world` is in metres."""

        def place(pose: Array) -> Array:
            return np.asarray(new_from_world @ rigid(pose[:3, :3], metres_per_unit * pose[:3, 3]))

        background = self.world_from_background
        return replace(
            self,
            world_from_camera=place(self.world_from_camera),
            world_from_background=None if background is None else place(background),
            suspects={mistake: place(pose) for mistake, pose in self.suspects.items()},
            rare_suspects={mistake: place(pose) for mistake, pose in self.rare_suspects.items()},
            flange_axis=None if self.flange_axis is None else new_from_world[:3, :3] @ self.flange_axis,
        )


@dataclass(frozen=True)
class Listed:
    """A photo that another program knows; its camera is read, and judged, when the photo is chosen."""

    name: str
    read: Callable[[], PosedImage]


def scene_of(posed_images: Sequence[PosedImage], pairs: Mapping[str, Pair], workspace: Workspace) -> Views:
    """The posed images that have both photos, in the order of the pairs, undistorted, as views.

    Raises `InputError` where there are more than `MAX_VIEWS`, and where a photo is not of its lens's size.
    """
    if len(pairs) > MAX_VIEWS:
        raise InputError(
            f"{len(pairs)} photos have a background; choose up to {MAX_VIEWS} of them with --views: "
            f"{shortened(pairs)}"
        )
    by_name = {posed.name: posed for posed in posed_images}
    return Views(tuple(_view(by_name[name], pair, workspace) for name, pair in pairs.items()), workspace)


def _view(posed: PosedImage, pair: Pair, workspace: Workspace) -> View:
    lens = posed.lens
    image, background = (_photo(file, posed) for file in (pair.image, pair.background))
    grid = lens.pixel_grid()
    places = lens.distorted(grid)
    background_places = _background_places(posed, workspace)
    inside = is_inside(lens, places)
    if lens.is_distorted:
        image = resampled(image, places)
    if background_places is not None:
        background, inside = (
            resampled(background, background_places),
            inside & is_inside(lens, background_places),
        )
    elif lens.is_distorted:
        background = resampled(background, places)
    sensed = full_rectangle(inside)
    if sensed is not None and (sensed[2] - sensed[0]) * (sensed[3] - sensed[1]) < LEAST_SHOWN * inside.size:
        raise InputError(
            f"{pair.background}: shows too little of what {pair.image.name} shows; photos and backgrounds "
            "must be taken from (nearly) the same place, and the lens' distortion must be moderate"
        )
    camera = Camera(lens.intrinsics, posed.world_from_camera, lens.width, lens.height, sensed)
    return View(camera, np.ascontiguousarray(image), np.ascontiguousarray(background), name=posed.name)


def _photo(file: Path, posed: PosedImage) -> Image:
    photo = read_image(file, posed.name)
    tags = photo_tags(file, posed.name)
    if tags.lies:
        logger.warning(
            "%s: EXIF orientation: the photo is stored %s. Pixels are read as they are stored, while OpenCV "
            "and most viewers turn them: the intrinsics must be those of the stored pixels. If they are not, "
            "store photos and backgrounds upright without the tag (`exiftran -ai`) and import again",
            file,
            tags.lies,
        )
    ratio = (tags.focal_pixels or posed.lens.intrinsics[0, 0]) / posed.lens.intrinsics[0, 0]
    if not 1 / OTHER_FOCAL <= ratio <= OTHER_FOCAL:
        logger.warning(
            "%s: EXIF focal length: the photo was taken at %g mm (of 35 mm film), %.2f times the focal "
            "length of its camera's calibration. Calibrate at the lens and the zoom of the photos",
            file,
            tags.focal_35mm,
            ratio,
        )
    height, width = photo.shape[:2]
    if (width, height) != (posed.lens.width, posed.lens.height):
        turned = (height, width) == (posed.lens.width, posed.lens.height)
        raise InputError(
            f"{file}: {width} x {height} pixels; its camera was calibrated for {posed.lens.width} x "
            f"{posed.lens.height}" + (" (the photo lies on its side)" if turned else "")
        )
    return photo


def _background_places(posed: PosedImage, workspace: Workspace) -> Array | None:
    """Where the background's camera shows what the image's camera would see of the empty table; None where
    both stood at one place."""
    if posed.world_from_background is None:
        return None
    world_from_workspace = workspace.world_from_workspace
    normal = world_from_workspace[:3, 2]
    table = np.array([*normal, normal @ workspace.to_world(workspace.centre)])
    places = seen_on_table(posed.lens, posed.world_from_camera, posed.world_from_background, table)
    if is_in_place(posed.lens, places):
        return None
    logger.info("%s: the background was taken from another place and is warped along the table", posed.name)
    return posed.lens.distorted(places)
