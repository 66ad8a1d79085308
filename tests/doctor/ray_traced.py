"""A good capture made in closed form: a box and a ball on a speckled table, with shadows and sensor noise."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy import ndimage

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views

TILE = 0.8
"""Metres after which the table's pattern repeats."""
BALL = (np.array([0.10, 0.17, 0.085]), 0.035)
BOX = (np.array([0.17, 0.08, 0.05]), np.array([0.23, 0.15, 0.11]))
NOISE = 0.006
"""Standard deviation of the sensor's noise, of 1."""


@dataclass(frozen=True)
class Room:
    """Everything that a photo depends on but the camera."""

    lamp: tuple[float, float, float] = (0.4, -0.3, 1.2)
    """Workspace frame, metres."""
    gain: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Exposure times white balance."""
    objects: tuple[str, ...] = ("ball", "box")
    """What stands on the table."""
    hand: tuple[float, float] | None = None
    """The middle of a dark disc on the table beside the cube."""
    seed: int = 0
    """Of the noise."""


def pattern(seed: int = 3, size: int = 800) -> np.ndarray:
    """(size, size, 3) albedo of a table: speckles of several sizes that go on where they end."""
    rng = np.random.default_rng(seed)
    layers = [ndimage.gaussian_filter(rng.normal(size=(size, size)), s, mode="wrap") for s in (2, 4, 9)]
    speckles = sum(layer / layer.std() for layer in layers)
    tint = np.array([0.20, 0.16, 0.12])
    return np.clip(np.array([0.42, 0.40, 0.36]) + 0.4 * tint * speckles[..., None], 0.03, 0.95)


TABLE = pattern()


def photo(camera: Camera, room: Room, workspace: Workspace | None = None) -> np.ndarray:
    """RGB (h, w, 3) uint8; the camera in the workspace frame."""
    height = (workspace or Workspace()).table_height
    eye = camera.centre
    rays = camera.unproject(camera.pixel_grid(), np.ones((camera.height, camera.width))) - eye
    depth = (height - eye[2]) / np.minimum(rays[..., 2], -1e-6)
    points = eye + depth[..., None] * rays
    normal = np.broadcast_to([0.0, 0.0, 1.0], points.shape).copy()
    albedo = _table_albedo(points, room)
    for reach, face, colour in (SOLIDS[name](eye, rays) for name in room.objects):
        nearer = reach < depth
        depth = np.where(nearer, reach, depth)
        normal = np.where(nearer[..., None], face, normal)
        albedo = np.where(nearer[..., None], colour, albedo)
    points = eye + depth[..., None] * rays
    lamp = np.array(room.lamp) - points
    distance = np.linalg.norm(lamp, axis=-1, keepdims=True)
    direct = np.clip((normal * lamp / distance).sum(-1, keepdims=True), 0, 1) * (1.2 / distance) ** 2
    direct = direct * (1 - 0.8 * _shadow(points + 1e-4 * normal, lamp, room)[..., None])
    light = albedo * (0.25 + 0.75 * direct) * np.array(room.gain)
    shown = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    shown = shown + np.random.default_rng(room.seed).normal(0, NOISE, shown.shape)
    return (shown * 255).round().clip(0, 255).astype(np.uint8)


def _table_albedo(points: np.ndarray, room: Room) -> np.ndarray:
    """The pattern at points of the table, and the hand that lies there."""
    size = TABLE.shape[0]
    places = [(points[..., axis] / TILE * size) for axis in (0, 1)]
    albedo = np.stack(
        [ndimage.map_coordinates(TABLE[..., c], places, order=1, mode="grid-wrap") for c in range(3)], axis=-1
    )
    if room.hand is not None:
        near = np.linalg.norm(points[..., :2] - np.array(room.hand), axis=-1) < 0.12
        albedo = np.where(near[..., None], (0.05, 0.04, 0.04), albedo)
    return albedo


def _ball(eye: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """Depth of the ball along the rays (infinite where missed), its normal, its colour."""
    offset = eye - BALL[0]
    a, b = (rays**2).sum(-1), (rays * offset).sum(-1)
    root = b**2 - a * ((offset * offset).sum(-1) - BALL[1] ** 2)
    reach = np.where(root > 0, (-b - np.sqrt(np.maximum(root, 0))) / a, np.inf)
    reach = np.where(reach > 1e-6, reach, np.inf)
    hit = eye + np.where(np.isfinite(reach), reach, 0)[..., None] * rays
    return reach, (hit - BALL[0]) / BALL[1], (0.55, 0.08, 0.05)


def _box(eye: np.ndarray, rays: np.ndarray) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """The same of the box."""
    safe = np.where(np.abs(rays) < 1e-9, 1e-9, rays)
    one, other = (BOX[0] - eye) / safe, (BOX[1] - eye) / safe
    enter, leave = np.minimum(one, other), np.maximum(one, other)
    reach = np.where((enter.max(-1) < leave.min(-1)) & (enter.max(-1) > 1e-6), enter.max(-1), np.inf)
    axis = enter.argmax(-1)
    normal = -np.sign(np.take_along_axis(rays, axis[..., None], -1)) * np.eye(3)[axis]
    return reach, normal, (0.10, 0.22, 0.45)


SOLIDS = {"ball": _ball, "box": _box}


def _shadow(points: np.ndarray, lamp: np.ndarray, room: Room) -> np.ndarray:
    """Whether an object stands between points and the lamp."""
    hits = [np.isfinite(SOLIDS[name](points, lamp)[0]) for name in room.objects]
    return np.any(hits, axis=0) if hits else np.zeros(points.shape[:-1], dtype=bool)


def good_capture(name: str = "released", size: tuple[int, int] = (640, 360)) -> Views:
    """Four views with their backgrounds, as a careful person takes them."""
    workspace = Workspace()
    cameras = view_set(name, workspace, np.random.default_rng(0))
    whole = (-0.5, -0.5, cameras[0].width - 0.5, cameras[0].height - 0.5)
    cameras = [replace(camera.cropped_and_resized(whole, *size), sensed=None) for camera in cameras]
    return Views(tuple(view_of(camera, Room(seed=i)) for i, camera in enumerate(cameras)), workspace)


def view_of(camera: Camera, room: Room, empty: Room | None = None) -> View:
    """A photo of the objects in one room, and of the empty table in another; by default the same."""
    empty = empty or replace(room, seed=room.seed + 100)
    return View(camera, photo(camera, room), photo(camera, replace(empty, objects=())))
