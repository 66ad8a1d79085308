"""A real camera on the wrist: drives from view to view, waits, photographs, and notes where it was."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from neugrasp.data.camera_checks import check_rigid
from neugrasp.data.fields import Fields
from neugrasp.data.photo_files import read_image
from neugrasp.data.strict_json import read_json
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array
from neugrasp.importers.resampling import resampled
from neugrasp.observation import Image, View, Views
from neugrasp.robot.cell_file import CameraPart, CellFile
from neugrasp.robot.errors import CameraFault
from neugrasp.robot.interface import Arm, Sensor
from neugrasp.robot.tour import Tour

PHOTO_S = 5.0
"""Seconds that a photo may take."""
DRIVING_S = 5.0
"""Seconds beyond the length of a motion."""
TREMBLING = 0.0005
"""Radians by which the joints may move while a photo is taken."""
ELSEWHERE_MM, ELSEWHERE = 3.0, 0.005
"""Millimetres, and rotation (of a matrix's entries), by which a background may be taken from elsewhere."""
POSES, FORMAT, VERSION = "cameras.json", "neugrasp-empty-table", 1


@dataclass(frozen=True)
class Shot:
    """One photo, and the camera that took it."""

    camera: Camera
    """In the user's world, from the joints that were measured."""
    image: Image


@dataclass(frozen=True)
class WristCamera:
    """The camera of a cell."""

    arm: Arm
    sensor: Sensor
    tour: Tour
    cell: CellFile

    def shots(self) -> tuple[Shot, ...]:
        """A photo from every view; the arm is out of sight afterwards. Raises a `RobotError`."""
        shots = []
        for number, stop in enumerate(self.tour.stops):
            self.arm.execute(stop.way, False, stop.way.duration + DRIVING_S)
            before = self.arm.state().joints
            taken = self.sensor.photo(PHOTO_S)
            after = self.arm.state().joints
            if np.abs(after - before).max() > TREMBLING:
                raise CameraFault(f"view {number}: the arm moved while the photo was taken")
            shots.append(Shot(self._camera(after), self._straightened(taken)))
        self.arm.execute(self.tour.home, False, self.tour.home.duration + DRIVING_S)
        return tuple(shots)

    def _straightened(self, image: Image) -> Image:
        """The photo without the distortion of its lens."""
        part = self.cell.camera
        if image.shape[:2] != (part.camera.height, part.camera.width):
            height, width = image.shape[:2]
            raise CameraFault(
                f"the camera gives {width} x {height} pixels; the cell file says {part.camera.width} x "
                f"{part.camera.height}"
            )
        if not part.lens.is_distorted:
            return image
        return resampled(image, part.lens.distorted(part.lens.pixel_grid()))

    def _camera(self, joints: Array) -> Camera:
        arm, part = self.cell.arm, self.cell.camera
        pose = arm.world_from_base @ arm.model.flange(joints) @ part.flange_from_camera
        return replace(part.camera, world_from_camera=pose)


@dataclass(frozen=True)
class Photographs:
    """Views with their backgrounds: what a detector is shown."""

    camera: WristCamera
    empty: tuple[Shot, ...]

    def capture(self) -> Views:
        """What lies on the table now."""
        shots = self.camera.shots()
        check_places(shots, self.empty)
        views = tuple(
            View(shot.camera, shot.image, empty.image, name=f"view {number}")
            for number, (shot, empty) in enumerate(zip(shots, self.empty, strict=True))
        )
        return Views(views, self.camera.cell.workspace)


def check_places(shots: Sequence[Shot], empty: Sequence[Shot]) -> None:
    """Raises `InputError` where the photos of the empty table were taken from elsewhere."""
    if len(shots) != len(empty):
        raise InputError(
            f"{len(empty)} photos of the empty table for {len(shots)} views; take them again (--empty)"
        )
    for number, (one, other) in enumerate(zip(shots, empty, strict=True)):
        apart = one.camera.world_from_camera - other.camera.world_from_camera
        if (
            1000 * np.linalg.norm(apart[:3, 3]) > ELSEWHERE_MM
            or np.abs(apart[:3, :3]).max() > ELSEWHERE
            or one.image.shape != other.image.shape
        ):
            raise InputError(
                f"view {number}: the empty table was photographed from elsewhere; take its photos again "
                "(--empty)"
            )


def write_empty(folder: Path, shots: Sequence[Shot], part: CameraPart) -> None:
    """Keeps the photos of the empty table, whole or not at all, with the lens that straightened them."""
    names = [f"{number}.png" for number in range(len(shots))]
    with whole_or_nothing(folder, (POSES, *names)) as kept:
        for name, shot in zip(names, shots, strict=True):
            Picture.fromarray(shot.image).save(kept / name)
        poses = [shot.camera.world_from_camera.tolist() for shot in shots]
        about = {"format": FORMAT, "version": VERSION, "lens": _lens_of(part), "poses": poses}
        (kept / POSES).write_text(json.dumps(about, indent=1) + "\n", encoding="utf-8")


def read_empty(folder: Path, part: CameraPart) -> tuple[Shot, ...]:
    """The reverse of `write_empty`. Raises `InputError` naming what is missing, or what has changed since."""
    file = folder / POSES
    if not file.is_file():
        raise InputError(f"{folder}: no photos of the empty table; take them with neugrasp capture --empty")
    told = read_json(file, "the poses of photos of the empty table")
    if not isinstance(told, dict) or (told.get("format"), told.get("version")) != (FORMAT, VERSION):
        raise InputError(f"{file}: of another version of neugrasp; take the photos again (--empty)")
    fields = Fields(f"{file}", told)
    if fields.get("lens") != _lens_of(part):
        raise InputError(f"{file}: the cell file has another lens now; take the photos again (--empty)")
    shots = []
    for number, pose in enumerate(fields.list("poses")):
        where, camera = f"{file}: poses[{number}]", part.camera
        image = read_image(folder / f"{number}.png", where)
        if image.shape[:2] != (camera.height, camera.width):
            raise InputError(f"{folder / f'{number}.png'}: of another size; take the photos again (--empty)")
        shots.append(Shot(replace(camera, world_from_camera=check_rigid(pose, where)), image))
    return tuple(shots)


def _lens_of(part: CameraPart) -> dict[str, object]:
    lens = part.lens
    distortion = [*map(float, (*lens.radial, *lens.tangential))]
    size = [part.camera.width, part.camera.height]
    return {"size": size, "intrinsics": part.camera.intrinsics.tolist(), "distortion": distortion}
