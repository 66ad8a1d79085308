"""The files that a prediction leaves behind: grasps.json, surface.ply, tsdf.npz, overlay.png."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from PIL import Image as Picture

from neugrasp.errors import InputError
from neugrasp.geometry.pose import from_quaternion, to_quaternion
from neugrasp.geometry.surface import Surface, surface_of
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.pictures import overlay_sheet
from neugrasp.views import Image, Views

if TYPE_CHECKING:
    from neugrasp.detection.detector import Detection

FORMAT = "neugrasp-grasps"
VERSION = 1


def write_prediction(folder: Path, views: Views, detection: Detection, gripper: Gripper) -> None:
    """The four files of a prediction, everything in the user's world."""
    workspace = views.workspace
    surface = surface_of(detection.tsdf, workspace).moved(workspace.world_from_workspace)
    write_surface(folder / "surface.ply", surface)
    write_tsdf(folder / "tsdf.npz", detection.tsdf, workspace)
    write_picture(folder / "overlay.png", overlay_sheet(views, detection.grasps, gripper))
    origin = {"scene": views.source, "gripper": gripper.name}
    write_grasps(folder / "grasps.json", detection.grasps, detection.rejected, detection.timing_s, origin)


def write_grasps(
    file: Path,
    grasps: Sequence[Grasp],
    rejected: Mapping[str, int] | None = None,
    timing_s: Mapping[str, float] | None = None,
    origin: Mapping[str, str] | None = None,
) -> None:
    """Grasps in the world frame, best first; how many candidates each reason rejected; seconds per stage;
    the scene and the gripper they were found for."""
    ordered = sorted(grasps, key=lambda grasp: -grasp.score)
    entries = [
        {
            "position": [float(x) for x in grasp.position],
            "quaternion_xyzw": [float(x) for x in to_quaternion(grasp.pose)],
            "width": float(grasp.width),
            "score": float(grasp.score),
        }
        for grasp in ordered
    ]
    content = {
        "format": FORMAT,
        "version": VERSION,
        "frame": "world",
        **{key: value for key, value in (origin or {}).items() if value},
        "grasps": entries,
        "rejected": {reason: int(count) for reason, count in (rejected or {}).items()},
        "timing_s": {stage: float(seconds) for stage, seconds in (timing_s or {}).items()},
    }
    file.write_text(json.dumps(content, indent=1, allow_nan=False) + "\n", encoding="utf-8")


def read_grasps(file: Path) -> list[Grasp]:
    """The grasps of a `grasps.json`, world frame. Raises `InputError` naming the file."""
    with naming_the_list(file):
        data = json.loads(file.read_text(encoding="utf-8"))
        if data["format"] != FORMAT or data["version"] != VERSION:
            raise InputError(f"{file}: not a {FORMAT} file of version {VERSION}")
        return [
            Grasp(
                from_quaternion(entry["quaternion_xyzw"], entry["position"]),
                float(entry["width"]),
                float(entry["score"]),
            )
            for entry in data["grasps"]
        ]


@contextmanager
def naming_the_list(file: Path) -> Iterator[None]:
    """Whatever is wrong with a list of grasps becomes an `InputError` that names its file."""
    try:
        yield
    except FileNotFoundError:
        raise InputError(f"{file}: missing") from None
    except InputError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{file}: damaged list of grasps ({error!r})") from error


def write_surface(file: Path, surface: Surface) -> None:
    """A binary little-endian PLY file with float32 vertices, metres."""
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment neugrasp surface, metres, world frame\n"
        f"element vertex {len(surface.vertices)}\nproperty float x\nproperty float y\nproperty float z\n"
        f"element face {len(surface.faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    faces = np.empty(len(surface.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, surface.faces
    with file.open("wb") as stream:
        stream.write(header.encode("ascii"))
        stream.write(surface.vertices.astype("<f4").tobytes())
        stream.write(faces.tobytes())


def write_tsdf(file: Path, tsdf: ArrayLike, workspace: Workspace) -> None:
    """The grid [x, y, z] with what places it: voxel (i, j, k) has its centre at (i + 0.5) voxel sizes."""
    np.savez_compressed(
        file,
        tsdf=np.asarray(tsdf, dtype=np.float32),
        size=workspace.size,
        truncation=workspace.truncation,
        world_from_workspace=workspace.world_from_workspace,
    )


def write_picture(file: Path, image: Image) -> None:
    """A file of the kind that its name says: PNG, or JPEG for many photos."""
    Picture.fromarray(image).save(file)
