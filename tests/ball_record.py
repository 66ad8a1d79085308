"""A record that needs neither physics nor Blender: a ball on a checkered table, ray-traced in closed form."""

from __future__ import annotations

import numpy as np

from neugrasp.data.labels import GraspLabels
from neugrasp.data.records import Record
from neugrasp.data.world import Body, Material, Scene
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at, to_quaternion
from neugrasp.geometry.view_sets import hemisphere, view_set
from neugrasp.geometry.workspace import USUAL, Workspace


def photo(camera: Camera, ball: tuple[np.ndarray, float] | None) -> tuple[np.ndarray, np.ndarray]:
    """RGB (h, w, 3) uint8 and z-depth (h, w) of the table with or without the ball (centre, radius)."""
    table = USUAL.table_height
    ahead = camera.unproject(camera.pixel_grid(), np.ones((camera.height, camera.width)))
    rays = ahead - camera.centre
    with np.errstate(divide="ignore"):
        depth = (table - camera.centre[2]) / rays[..., 2]
    depth = np.where(depth > 0, depth, 10.0)
    where = camera.centre + depth[..., None] * rays
    checks = (np.floor(where[..., 0] / 0.03) + np.floor(where[..., 1] / 0.03)) % 2
    colour = np.where(checks[..., None] == 1, (0.75, 0.7, 0.6), (0.35, 0.4, 0.45))
    if ball is not None:
        offset = camera.centre - ball[0]
        a, b = (rays**2).sum(-1), (rays * offset).sum(-1)
        root = b**2 - a * (offset @ offset - ball[1] ** 2)
        at = (-b - np.sqrt(np.maximum(root, 0))) / a
        normal = (camera.centre + at[..., None] * rays - ball[0]) / ball[1]
        shade = 0.35 + 0.65 * np.clip(normal[..., 2:], 0, 1)
        hit = (root > 0)[..., None]
        colour = np.where(hit, shade * np.array([0.9, 0.15, 0.1]), colour)
        depth = np.where(hit[..., 0], at, depth)
    return (colour * 255).round().astype(np.uint8), depth.astype(np.float32)


def ball_record(
    x: float = 0.15,
    y: float = 0.15,
    radius: float = 0.03,
    size: int = 64,
    seed: int = 0,
    workspace: Workspace = USUAL,
) -> Record:
    """Four input views and two targets of a ball that lies at (x, y)."""
    rng = np.random.default_rng(seed)
    views = [*view_set("released", workspace, rng), *hemisphere(workspace, rng, 2)]
    cameras = [camera.cropped_and_resized(workspace.photo_box(camera), size, size) for camera in views]
    ball = (np.array([x, y, workspace.table_height + radius]), radius)
    shots = [photo(camera, ball) for camera in cameras]
    empty = [photo(camera, None)[0] for camera in cameras]
    centres = workspace.voxel_centres()
    distance = np.minimum(
        np.linalg.norm(centres - ball[0], axis=-1) - radius, centres[..., 2] - workspace.table_height
    )
    images = np.stack([shot[0] for shot in shots])
    return Record(
        name=f"ball-{seed}",
        scene=Scene(
            "single",
            seed,
            (Body("balls", "ball", 1.0, tuple(ball[0]), (0.0, 0.0, 0.0, 1.0)),),
            (Material("diffuse", "red", {}),),
        ),
        cell={"seed": 0, **({"workspace": unusual} if (unusual := workspace.unusual()) else {})},
        images=images[:4],
        backgrounds=np.stack(empty[:4]),
        cameras=tuple(cameras[:4]),
        targets=images[4:],
        target_backgrounds=np.stack(empty[4:]),
        target_cameras=tuple(cameras[4:]),
        depths=np.stack([shot[1] for shot in shots[:4]]),
        masks=np.zeros((4, size, size), dtype=np.int8),
        tsdf=(distance / workspace.truncation).clip(-1, 1).astype(np.float32),
        observed=np.ones((workspace.resolution,) * 3, dtype=bool),
        labels=ball_labels(ball, rng),
    )


def ball_labels(ball: tuple[np.ndarray, float], rng: np.random.Generator) -> GraspLabels:
    """Grasps from above succeed at the top of the ball and fail beside it."""
    above = ball[0] + np.array([0, 0, ball[1] + 0.005]) + rng.uniform(-0.004, 0.004, (20, 3))
    beside = ball[0] + np.array([2.5 * ball[1], 0, 0]) + rng.uniform(-0.01, 0.01, (20, 3))
    down = to_quaternion(look_at((0, 0, 1), (0, 0, 0)))
    return GraspLabels(
        points=np.concatenate([above, beside]).astype(np.float32),
        quaternions=np.tile(down, (40, 1)).astype(np.float32),
        widths=np.full(40, 2 * ball[1], dtype=np.float32),
        success=np.arange(40) < 20,
    )
