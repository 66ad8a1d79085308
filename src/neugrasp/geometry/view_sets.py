"""The named sets of viewpoints. Polar angles are measured from the vertical (docs/reproduction.md)."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at
from neugrasp.geometry.workspace import Workspace

SENSOR = (640, 360)
"""Width and height of the D435 stream that the paper uses."""
FOCAL = 459.14
PRINCIPAL_POINT = (319.75, 179.75)
VGN_SENSOR = (640, 480)
VGN_FOCAL = 540.0


def sensor_camera(eye: Float[np.ndarray, " 3"], target: Float[np.ndarray, " 3"]) -> Camera:
    """The paper's simulated D435 at `eye`, looking at `target`."""
    intrinsics = np.array([[FOCAL, 0, PRINCIPAL_POINT[0]], [0, FOCAL, PRINCIPAL_POINT[1]], [0, 0, 1.0]])
    return Camera(intrinsics, look_at(eye, target), *SENSOR)


def on_sphere(workspace: Workspace, radius: float, polar: float, azimuth: float) -> Camera:
    """A camera at polar coordinates (metres, radians) about the middle of the table, workspace frame."""
    offset = np.array([np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)])
    return sensor_camera(workspace.centre + radius * offset, workspace.centre)


def _arc(
    workspace: Workspace, radius: float, polar_deg: list[float], azimuth_deg: list[float]
) -> list[Camera]:
    polar, azimuth = np.deg2rad(polar_deg), np.deg2rad(azimuth_deg)
    return [on_sphere(workspace, radius, p, a) for p, a in zip(polar, azimuth, strict=True)]


def released(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """The evaluation arc of the released code: 4 views, fixed."""
    return _arc(workspace, 0.5, [45, 35, 25, 15], [240, 260, 280, 300])


def groups8(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """The real scenes of the released code: `released`, and as many on the same arc, 120 degrees on."""
    second = _arc(workspace, 0.5, [45, 35, 25, 15], [0, 20, 40, 60])
    return [*released(workspace, rng), *second]


def paper(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """The paper's text: 4 views, polar U(15, 22.5) deg, spread over 60 deg of azimuth, r U(0.4, 0.5)."""
    start = rng.uniform(0, 360)
    polar = rng.uniform(15, 22.5, size=4).tolist()
    return _arc(workspace, rng.uniform(0.4, 0.5), polar, [start + 20 * j for j in range(4)])


def training(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """A superset of `paper` and `released`, with jittered poses: each with probability one half."""
    start, radius = rng.uniform(0, 360), rng.uniform(0.4, 0.5)
    if rng.random() < 0.5:
        polar = np.linspace(rng.uniform(41, 45), rng.uniform(12, 16), 4)
    else:
        polar = rng.uniform(15, 22.5, size=4)
    azimuth = start + 20 * np.arange(4) + rng.uniform(-3, 3, size=4)
    radii = radius + rng.uniform(-0.01, 0.01, size=4)
    return [
        on_sphere(workspace, r, p, a)
        for r, p, a in zip(radii, np.deg2rad(polar), np.deg2rad(azimuth), strict=True)
    ]


def ring6(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """GraspNeRF: 6 views around the table at a polar angle of 35 deg."""
    return _arc(workspace, 0.5, [35] * 6, [60 * j for j in range(1, 7)])


def hemisphere6(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """VGN's evaluation: 6 views at a polar angle of 30 deg, 0.6 m from the middle of the cube's floor, which
    lies under the table, with VGN's camera."""
    return [_vgn_camera(workspace, 0.6, np.deg2rad(30), np.deg2rad(60.0 * i)) for i in range(6)]


def vgn_training(workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """VGN's training: 1 to 6 views from anywhere up to 45 deg from the vertical, r U(0.48, 0.72)."""
    count = int(rng.integers(1, 7))
    places = rng.uniform((0.48, 0, 0), (0.72, np.pi / 4, 2 * np.pi), (count, 3)).tolist()
    return [_vgn_camera(workspace, *place) for place in places]


def _vgn_camera(workspace: Workspace, radius: float, polar: float, azimuth: float) -> Camera:
    """VGN's camera at polar coordinates (metres, radians) about the middle of the cube's floor, which it
    looks at."""
    floor = workspace.centre * (1, 1, 0)
    intrinsics = np.array([[VGN_FOCAL, 0, VGN_SENSOR[0] / 2], [0, VGN_FOCAL, VGN_SENSOR[1] / 2], [0, 0, 1.0]])
    direction = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
    eye = floor + radius * np.array(direction)
    return Camera(intrinsics, look_at(eye, floor), *VGN_SENSOR)


def hemisphere(workspace: Workspace, rng: np.random.Generator, num: int = 4) -> list[Camera]:
    """Photometric targets: `num` views from anywhere on the hemisphere between 5 and 75 deg."""
    cosines = rng.uniform(np.cos(np.deg2rad(75)), np.cos(np.deg2rad(5)), size=num)
    azimuths = rng.uniform(0, 2 * np.pi, size=num)
    radii = rng.uniform(0.4, 0.5, size=num)
    return [
        on_sphere(workspace, r, float(np.arccos(c)), a)
        for r, c, a in zip(radii, cosines, azimuths, strict=True)
    ]


VIEW_SETS: dict[str, Callable[[Workspace, np.random.Generator], list[Camera]]] = {
    "paper": paper,
    "released": released,
    "training": training,
    "groups8": groups8,
    "ring6": ring6,
    "hemisphere6": hemisphere6,
}


def view_set(name: str, workspace: Workspace, rng: np.random.Generator) -> list[Camera]:
    """The cameras of a named view set, in the workspace frame. Raises `InputError` on an unknown name."""
    if name not in VIEW_SETS:
        raise InputError(f"unknown view set {name!r}; choose one of {', '.join(VIEW_SETS)}")
    return VIEW_SETS[name](workspace, rng)
