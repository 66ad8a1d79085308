"""Scenes as other programs would have written them, to import them again."""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from PIL import Image as Picture

from neugrasp.geometry.pose import Array, inverse, rigid, rotation_about, to_quaternion, to_rotation_vector
from neugrasp.observation import View, Views

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
COLMAP_MODELS = {"SIMPLE_PINHOLE": 0, "PINHOLE": 1, "SIMPLE_RADIAL": 2, "RADIAL": 3, "OPENCV": 4}


@dataclass(frozen=True)
class Similarity:
    """reconstruction = rotation and shift of world / metres_per_unit, as structure from motion has it."""

    metres_per_unit: float = 1.0
    world_from_reconstruction: Array = field(default_factory=rigid)

    def unmetric(self, world_from_camera: Array) -> Array:
        """`reconstruction_from_camera` in the reconstruction's unit."""
        pose = inverse(self.world_from_reconstruction) @ world_from_camera
        pose[:3, 3] /= self.metres_per_unit
        return pose

    def write(self, file: Path, views: Views) -> Path:
        """The alignment file that undoes it."""
        data = {
            "metres_per_unit": self.metres_per_unit,
            "world_from_reconstruction": self.world_from_reconstruction.tolist(),
            "world_from_workspace": views.workspace.world_from_workspace.tolist(),
        }
        file.write_text(json.dumps(data))
        return file


ARBITRARY = Similarity(0.37, rigid(rotation_about((1, 2, -3), 1.1), (0.4, -0.2, 0.9)))


def whole_photos(views: Views) -> Views:
    """The views without their padding: what a camera, rather than a crop, would have taken."""

    def cut(view: View) -> View:
        left, top, right, bottom = view.camera.bounds
        x, y = slice(int(np.ceil(left)), int(right) + 1), slice(int(np.ceil(top)), int(bottom) + 1)
        image, background = (np.ascontiguousarray(photo[y, x]) for photo in (view.image, view.background))
        intrinsics = view.camera.intrinsics.copy()
        intrinsics[:2, 2] -= (x.start, y.start)
        height, width = image.shape[:2]
        camera = replace(view.camera, intrinsics=intrinsics, width=width, height=height, sensed=None)
        return View(camera, image, background, name=view.name)

    return replace(views, frames=tuple(cut(view) for view in views.frames))


def write_photos(folder: Path, views: Views) -> None:
    """images/view_0.png ... and backgrounds/view_0.png ..."""
    for i, view in enumerate(views.frames):
        for kind, pixels in (("images", view.image), ("backgrounds", view.background)):
            (folder / kind).mkdir(parents=True, exist_ok=True)
            Picture.fromarray(pixels).save(folder / kind / f"view_{i}.png")


def write_nerfstudio(folder: Path, views: Views, similarity: Similarity) -> Path:
    """transforms.json with OpenGL cameras, each with its own intrinsics."""
    write_photos(folder, views)
    frames = []
    for i, view in enumerate(views.frames):
        camera = view.camera
        frames.append(
            {
                "file_path": f"./images/view_{i}.png",
                "transform_matrix": (similarity.unmetric(camera.world_from_camera) @ OPENGL).tolist(),
                "fl_x": camera.intrinsics[0, 0],
                "fl_y": camera.intrinsics[1, 1],
                "cx": camera.intrinsics[0, 2] + 0.5,
                "cy": camera.intrinsics[1, 2] + 0.5,
                "w": camera.width,
                "h": camera.height,
            }
        )
    file = folder / "transforms.json"
    file.write_text(json.dumps({"camera_model": "OPENCV", "k1": 0.0, "frames": frames}))
    return file


def write_colmap(folder: Path, views: Views, similarity: Similarity, is_binary: bool) -> Path:
    """A model in sparse/0 with PINHOLE cameras, and two points for each image to be skipped."""
    write_photos(folder, views)
    model = folder / "sparse/0"
    model.mkdir(parents=True)
    cameras, images = [], []
    for i, view in enumerate(views.frames):
        camera = view.camera
        (fx, _, cx), (_, fy, cy), _ = camera.intrinsics.tolist()
        cameras.append((i + 1, "PINHOLE", camera.width, camera.height, [fx, fy, cx + 0.5, cy + 0.5]))
        camera_from_world = inverse(similarity.unmetric(camera.world_from_camera))
        x, y, z, w = to_quaternion(camera_from_world).tolist()
        images.append((i + 1, [w, x, y, z, *camera_from_world[:3, 3].tolist()], i + 1, f"view_{i}.png"))
    write = _write_binary if is_binary else _write_text
    write(model, cameras, images)
    return model


Cameras = list[tuple[int, str, int, int, list[float]]]
Images = list[tuple[int, list[float], int, str]]


def _write_text(model: Path, cameras: Cameras, images: Images) -> None:
    lines = [" ".join(map(str, (n, kind, w, h, *values))) for n, kind, w, h, values in cameras]
    (model / "cameras.txt").write_text("\n".join(["# Camera list", *lines]) + "\n")
    lines = []
    for i, (n, pose, camera, name) in enumerate(images):
        # COLMAP leaves the line of the points empty where there are none.
        lines += [" ".join(map(str, (n, *pose, camera, name))), "" if i == 1 else "3.5 4.5 -1 7.0 8.0 12"]
    (model / "images.txt").write_text("\n".join(["# Image list", "#", *lines]) + "\n")


def _write_binary(model: Path, cameras: Cameras, images: Images) -> None:
    data = struct.pack("<Q", len(cameras))
    for n, kind, w, h, values in cameras:
        data += struct.pack(f"<iiQQ{len(values)}d", n, COLMAP_MODELS[kind], w, h, *values)
    (model / "cameras.bin").write_bytes(data)
    data = struct.pack("<Q", len(images))
    for n, pose, camera, name in images:
        data += struct.pack("<i7di", n, *pose, camera) + name.encode() + b"\0"
        data += struct.pack("<Q", 2) + 2 * struct.pack("<ddq", 3.5, 4.5, -1)
    (model / "images.bin").write_bytes(data)


FLANGE_FROM_CAMERA = rigid(rotation_about((0.1, 0.2, 1), 0.8), (0.05, -0.02, 0.07))


def write_robot(folder: Path, views: Views, is_csv: bool = False, is_ur: bool = False) -> Path:
    """robot.json, with rotation vectors where it is of Universal Robots; the cameras must share one lens."""
    write_photos(folder, views)
    camera = views.frames[0].camera
    poses = [view.camera.world_from_camera @ inverse(FLANGE_FROM_CAMERA) for view in views.frames]
    data = {
        "intrinsics": camera.intrinsics.tolist(),
        "width": camera.width,
        "height": camera.height,
        "flange_from_camera": {
            "position": FLANGE_FROM_CAMERA[:3, 3].tolist(),
            "quaternion_xyzw": to_quaternion(FLANGE_FROM_CAMERA).tolist(),
        },
        "views": "poses.csv",
    }
    if is_ur:
        data["flange_from_camera"] = {
            "position": FLANGE_FROM_CAMERA[:3, 3].tolist(),
            "rotation_vector": to_rotation_vector(FLANGE_FROM_CAMERA).tolist(),
        }
    if is_csv and is_ur:
        rows = [[f"view_{i}.png", *pose[:3, 3], *to_rotation_vector(pose)] for i, pose in enumerate(poses)]
        lines = [",".join(map(str, row)) for row in rows]
        (folder / "poses.csv").write_text("\n".join(["image, x, y, z, rx, ry, rz", *lines]) + "\n")
    elif is_ur:
        data["views"] = [
            {
                "image": f"view_{i}.png",
                "base_from_flange": {
                    "position": pose[:3, 3].tolist(),
                    "rotation_vector": to_rotation_vector(pose).tolist(),
                },
            }
            for i, pose in enumerate(poses)
        ]
    elif is_csv:
        lines = [
            ",".join(map(str, (f"view_{i}.png", *pose[:3, 3], *to_quaternion(pose))))
            for i, pose in enumerate(poses)
        ]
        (folder / "poses.csv").write_text("\n".join(["image, x, y, z, qx, qy, qz, qw", *lines]) + "\n")
    else:
        data["views"] = [
            {"image": f"view_{i}.png", "base_from_flange": pose.tolist()} for i, pose in enumerate(poses)
        ]
    file = folder / "robot.json"
    file.write_text(json.dumps(data))
    return file
