"""A good capture spoilt in one way at a time, and the diagnosis that each must get."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from ray_traced import Room, photo, view_of
from scipy import ndimage

from neugrasp.doctor import messages
from neugrasp.doctor.findings import Level, Problem
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import from_quaternion, inverse, look_at, rigid, rotation_about, to_quaternion
from neugrasp.observation import View, Views

Spoil = Callable[[Views], Views]
GL = np.diag([1.0, -1.0, -1.0, 1.0])
BODY = rigid([[0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""opencv_from_body; bodies have x forward, y left, z up."""
RED, YELLOW = Level.RED, Level.YELLOW


@dataclass(frozen=True)
class Case:
    """One broken capture."""

    what: str
    """What was done to the good one."""
    spoil: Spoil
    problem: Problem
    level: Level
    views: tuple[int, ...] = ()
    """The views that the diagnosis must name."""
    is_mendable: bool = False
    """Whether the corrected copy must be the good capture again."""
    tolerance: float = 1e-9
    """Metres, and of rotation matrices, by which the corrected copy may differ."""


def each(change: Callable[[View], View], only: tuple[int, ...] = (0, 1, 2, 3)) -> Spoil:
    """Some or all views changed."""
    return lambda views: replace(
        views, frames=tuple(change(view) if i in only else view for i, view in enumerate(views.frames))
    )


def pose(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[View], View]:
    """A view with another pose."""
    return lambda view: replace(
        view, camera=replace(view.camera, world_from_camera=change(view.camera.world_from_camera))
    )


def intrinsics(scale: tuple[float, float, float]) -> Callable[[View], View]:
    """A view whose fx, fy, and principal point are multiplied."""
    factors = np.array([[scale[0], 1, scale[2]], [1, scale[1], scale[2]], [1, 1, 1]])
    return lambda view: replace(
        view, camera=replace(view.camera, intrinsics=view.camera.intrinsics * factors)
    )


def scaled(unit: float) -> Callable[[np.ndarray], np.ndarray]:
    """A pose in another unit."""
    return lambda matrix: matrix * np.array([[1, 1, 1, unit]] * 3 + [[1, 1, 1, 1]])


def cube(change: Callable[[np.ndarray], np.ndarray]) -> Spoil:
    """The workspace elsewhere."""
    return lambda views: replace(
        views,
        workspace=replace(views.workspace, world_from_workspace=change(views.workspace.world_from_workspace)),
    )


def backgrounds(order: tuple[int, ...]) -> Spoil:
    """The backgrounds in another order."""
    return lambda views: replace(
        views,
        frames=tuple(
            replace(v, background=views.frames[j].background)
            for v, j in zip(views.frames, order, strict=True)
        ),
    )


def images(order: tuple[int, ...]) -> Spoil:
    """The images in another order."""
    return lambda views: replace(
        views,
        frames=tuple(
            replace(v, image=views.frames[j].image) for v, j in zip(views.frames, order, strict=True)
        ),
    )


def lidded(view: View) -> View:
    """The lid was on when the photo of the empty table was taken."""
    return replace(view, background=np.zeros_like(view.background))


def poses(order: tuple[int, ...]) -> Spoil:
    """The poses in another order."""
    return lambda views: replace(
        views,
        frames=tuple(
            replace(v, camera=replace(v.camera, world_from_camera=views.frames[j].camera.world_from_camera))
            for v, j in zip(views.frames, order, strict=True)
        ),
    )


def lit(room: Room) -> Callable[[View], View]:
    """The photo of the objects taken again in another room."""
    return lambda view: replace(view, image=photo(view.camera, room))


def flipped(both: bool = True) -> Callable[[View], View]:
    """Mirrored photos."""

    def change(view: View) -> View:
        background = np.ascontiguousarray(view.background[:, ::-1]) if both else view.background
        return replace(view, image=np.ascontiguousarray(view.image[:, ::-1]), background=background)

    return change


def upside_down(view: View) -> View:
    """Both photos turned by half a turn."""
    turned = [np.ascontiguousarray(picture[::-1, ::-1]) for picture in (view.image, view.background)]
    return replace(view, image=turned[0], background=turned[1])


def blurred(view: View) -> View:
    """A photo taken in motion."""
    picture = ndimage.uniform_filter1d(ndimage.gaussian_filter(view.image, (1.0, 1.0, 0)), 9, axis=1)
    return replace(view, image=picture)


def shifted(x: float, y: float) -> Callable[[View], View]:
    """A background from a camera that was bumped."""
    return lambda view: replace(
        view, background=ndimage.shift(view.background, (y, x, 0), order=1, mode="nearest")
    )


def exposed(gain: float) -> Callable[[View], View]:
    """Both photos far too bright or too dark."""
    return lambda view: view_of(view.camera, Room(gain=(gain, gain, gain)))


def out_of_focus(view: View) -> View:
    """Both photos."""
    image, background = (ndimage.gaussian_filter(p, (3, 3, 0)) for p in (view.image, view.background))
    return replace(view, image=image, background=background)


def left_standing(view: View) -> View:
    """A photo of the empty table on which one object was forgotten."""
    return replace(view, background=photo(view.camera, Room(objects=("ball",), seed=55)))


def other_quaternion(turns: int) -> Callable[[np.ndarray], np.ndarray]:
    """A pose whose quaternion was written in one order and read in another."""
    return lambda p: from_quaternion(np.roll(to_quaternion(p), turns), p[:3, 3])


def turned(axis: tuple[float, float, float], degrees: float) -> np.ndarray:
    """A rotation as a transform."""
    return rigid(rotation_about(axis, np.deg2rad(degrees)))


def from_one_place(views: Views) -> Views:
    """Four cameras within a centimetre."""
    first = views.frames[0].camera
    cameras = [
        replace(first, world_from_camera=rigid(first.world_from_camera[:3, :3], first.centre + d * 0.002))
        for d in np.eye(3)
    ]
    return replace(
        views, frames=tuple(view_of(camera, Room(seed=i)) for i, camera in enumerate([first, *cameras]))
    )


def aimed_past(views: Views) -> Views:
    """Cameras that have half of the cube in the photo."""

    def turned(camera: Camera) -> Camera:
        beside = look_at(camera.centre, views.workspace.centre + np.array([0.33, 0.0, 0.0]))
        return replace(camera, world_from_camera=beside)

    return replace(
        views, frames=tuple(view_of(turned(v.camera), Room(seed=i)) for i, v in enumerate(views.frames))
    )


def far_away(views: Views) -> Views:
    """Cameras 1.5 m away, with the same lens."""

    def moved(camera: Camera) -> Camera:
        eye = views.workspace.centre + 3 * (camera.centre - views.workspace.centre)
        return replace(camera, world_from_camera=rigid(camera.world_from_camera[:3, :3], eye))

    return replace(
        views, frames=tuple(view_of(moved(v.camera), Room(seed=i)) for i, v in enumerate(views.frames))
    )


def exchanged(view: View) -> View:
    """Image for background."""
    return replace(view, image=view.background, background=view.image)


def empty(view: View) -> View:
    """A photo of the empty table for the image."""
    return replace(view, image=photo(view.camera, Room(objects=(), seed=77)))


CASES = [
    Case("cameras of OpenGL or Blender", each(pose(lambda p: p @ GL)), messages.OPENGL, RED, (), True),
    Case("poses inverted", each(pose(inverse)), messages.INVERTED, RED, (), True),
    Case(
        "view matrices of OpenGL",
        each(pose(lambda p: inverse(p @ GL))),
        messages.INVERTED_OPENGL,
        RED,
        (),
        True,
    ),
    Case("one pose inverted", each(pose(inverse), (2,)), messages.INVERTED, RED, (2,), True),
    Case(
        "rotations inverted",
        each(pose(lambda p: rigid(p[:3, :3].T, p[:3, 3]))),
        messages.INVERTED_ROTATION,
        RED,
        (),
        True,
    ),
    Case(
        "quaternions w x y z read as x y z w",
        each(pose(other_quaternion(1))),
        messages.QUATERNION_ORDER,
        RED,
        (),
        True,
    ),
    Case(
        "quaternions x y z w read as w x y z",
        each(pose(other_quaternion(-1))),
        messages.QUATERNION_ORDER,
        RED,
        (),
        True,
    ),
    Case(
        "camera bodies of ROS for optical frames",
        each(pose(lambda p: p @ BODY)),
        messages.BODY_FRAME,
        RED,
        (),
        True,
    ),
    Case("poses in millimetres", each(pose(scaled(1000))), messages.UNITS, RED, (), True),
    Case("poses in centimetres", each(pose(scaled(100))), messages.UNITS, RED, (), True),
    Case(
        "OpenGL cameras in millimetres",
        each(pose(lambda p: scaled(1000)(p @ GL))),
        messages.OPENGL,
        RED,
        (),
        True,
    ),
    Case(
        "the cube 5 cm too high",
        cube(lambda p: p @ rigid(translation=(0, 0, 0.05))),
        messages.TABLE_HEIGHT,
        RED,
        (),
        True,
    ),
    Case(
        "the cube upside down",
        cube(lambda p: p @ rigid(np.diag([1.0, -1, -1]), (0, 0.3, 0.1))),
        messages.CAMERA_BELOW_TABLE,
        RED,
    ),
    Case("the cube 3 m away", cube(lambda p: p @ rigid(translation=(3, 0, 0))), messages.CUBE_NOT_SEEN, RED),
    Case(
        "the cube tilted by 4 degrees",
        cube(lambda p: p @ turned((1, 0, 0), 4)),
        messages.TABLE_TILTED,
        YELLOW,
        (),
        True,
        0.004,
    ),
    Case(
        "one camera 2 cm off",
        each(pose(lambda p: rigid(translation=(0.02, 0, 0)) @ p), (1,)),
        messages.TABLE_OFFSET,
        RED,
        (1,),
    ),
    Case(
        "poses of the flange for the camera's",
        each(pose(lambda p: p @ turned((1, 0, 0), 15) @ rigid(translation=(0, 0.05, 0.03)))),
        messages.TABLE_OFFSET,
        RED,
    ),
    Case("two poses exchanged", poses((0, 2, 1, 3)), messages.VIEW_ORDER, RED, (1, 2), True),
    Case(
        "intrinsics of twice the resolution",
        each(intrinsics((2, 2, 2.0))),
        messages.OTHER_RESOLUTION,
        RED,
        (),
        True,
    ),
    Case("focal length 25 % too long", each(intrinsics((1.25, 1.25, 1))), messages.FOCAL_LENGTH, RED),
    Case("fx 10 % larger than fy", each(intrinsics((1.1, 1, 1))), messages.UNEQUAL_FOCAL, YELLOW),
    Case("all photos mirrored", each(flipped()), messages.MIRRORED, RED),
    Case("one photo upside down", each(upside_down, (3,)), messages.MIRRORED, RED, (3,)),
    Case("one image mirrored, its background not", each(flipped(False), (1,)), messages.MIRRORED, RED, (1,)),
    Case("two backgrounds swapped", backgrounds((1, 0, 2, 3)), messages.SWAPPED, RED, (0, 1), True),
    Case("images and backgrounds exchanged", each(exchanged), messages.EXCHANGED, RED, (), True),
    Case(
        "image and background of one view exchanged",
        each(exchanged, (1,)),
        messages.EXCHANGED,
        RED,
        (1,),
        True,
    ),
    Case("those of two views exchanged", each(exchanged, (0, 2)), messages.EXCHANGED, RED, (0, 2), True),
    Case(
        "those of three views exchanged", each(exchanged, (0, 2, 3)), messages.EXCHANGED, RED, (0, 2, 3), True
    ),
    Case("two images swapped", images((1, 0, 2, 3)), messages.SWAPPED, RED, (0, 1), True),
    Case("all images one view further", images((1, 2, 3, 0)), messages.SWAPPED, RED, (0, 1, 2, 3), True),
    Case("a lid on the camera for the empty table", each(lidded), messages.DARK, RED),
    Case(
        "one background shifted by (2.4, -1.2) pixels",
        each(shifted(2.4, -1.2), (1,)),
        messages.SHIFTED,
        RED,
        (1,),
    ),
    Case(
        "one background shifted by half a pixel", each(shifted(0.5, 0), (0,)), messages.SHIFTED, YELLOW, (0,)
    ),
    Case(
        "a background from another place",
        lambda v: replace(
            v,
            frames=(
                replace(
                    v.frames[0],
                    background=photo(
                        replace(
                            v.frames[0].camera, world_from_camera=look_at((0.4, 0.5, 0.4), (0.15, 0.15, 0.05))
                        ),
                        Room(objects=()),
                    ),
                ),
                *v.frames[1:],
            ),
        ),
        messages.BACKGROUND_DIFFERS,
        RED,
        (0,),
    ),
    Case("one object left on the empty table", each(left_standing), messages.NOT_EMPTY, YELLOW),
    Case("one stop more exposure", each(lit(Room(gain=(2.0, 2.0, 2.0)))), messages.EXPOSURE, RED),
    Case("warmer white balance", each(lit(Room(gain=(1.15, 1.0, 0.85)))), messages.WHITE_BALANCE, YELLOW),
    Case(
        "the lamp moved to the other side", each(lit(Room(lamp=(-0.35, 0.5, 0.5)))), messages.LIGHT_MOVED, RED
    ),
    Case(
        "a hand beside the cube", each(lit(Room(hand=(0.42, 0.15)))), messages.CHANGED_OUTSIDE, YELLOW, (2, 3)
    ),
    Case("half of the cube outside of the photos", aimed_past, messages.LITTLE_SEEN, YELLOW, (1, 2, 3)),
    Case("cameras 1.5 m away", far_away, messages.SMALL_IN_PHOTO, YELLOW),
    Case("all photos from one place", from_one_place, messages.NO_BASELINE, RED),
    Case(
        "one view given twice",
        lambda v: replace(v, frames=(*v.frames[:3], v.frames[0])),
        messages.SAME_PLACE,
        YELLOW,
        (0, 3),
    ),
    Case("one view only", lambda v: replace(v, frames=v.frames[:1]), messages.SINGLE_VIEW, YELLOW),
    Case("one image blurred by motion", each(blurred, (2,)), messages.BLURRED, YELLOW, (2,)),
    Case("all photos out of focus", each(out_of_focus), messages.BLURRED, YELLOW),
    Case("photos underexposed", each(exposed(0.01)), messages.DARK, RED),
    Case("photos overexposed", each(exposed(5.0)), messages.SATURATED, RED),
    Case(
        "each image is its own background",
        each(lambda v: replace(v, background=v.image)),
        messages.SAME_PHOTO,
        RED,
    ),
    Case("nothing on the table", each(empty), messages.NOTHING_THERE, YELLOW),
]
