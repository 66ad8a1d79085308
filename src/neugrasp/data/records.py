"""One simulated scene with everything that is known about it, in memory and as a folder on disk.

The folder is an ordinary scene (scene.json, images/, backgrounds/); beside it lie `targets/`, a second scene
with the views from the hemisphere, world.json, cell.json, truth.npz, grasps.npz and trials.npz.
docs/data_format.md describes each. A record without photos has only the last five; older ones have no
trials.npz.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.fields import Fields
from neugrasp.data.grasp_scene import GraspScene, SceneTruth
from neugrasp.data.labels import LABELS_FILE, GraspLabels, labels_from_bytes, labels_to_bytes
from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.data.strict_json import read_json
from neugrasp.data.trials import Trials, trials_from_bytes, trials_to_bytes
from neugrasp.data.truth_file import truth_from_bytes, truth_to_bytes
from neugrasp.data.user_files import read_bytes
from neugrasp.data.whole_or_nothing import whole_folder
from neugrasp.data.world import Scene, scene_from_json, scene_to_json
from neugrasp.errors import DataError, InputError, told_as
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import View, Views

FILES = ("world.json", "cell.json", "truth.npz", LABELS_FILE)
TRIALS_FILE = "trials.npz"
PHOTO_FILES = ("scene.json", "targets/scene.json")
NO_PHOTOS = np.zeros((0, 0, 0, 3), np.uint8)


@dataclass(frozen=True)
class Record:
    """A scene as training and evaluation use it: n input views and m targets of s x s pixels.

    Without photos n and m are 0, and it serves the grasp head alone.
    """

    name: str
    scene: Scene
    """Bodies and materials."""
    cell: Mapping[str, Any]
    """Seed, light, table and view set of the work cell, as the generator drew them."""
    images: NDArray[np.uint8]
    """(n, s, s, 3)"""
    backgrounds: NDArray[np.uint8]
    """(n, s, s, 3)"""
    cameras: tuple[Camera, ...]
    """n, in the workspace frame."""
    targets: NDArray[np.uint8]
    """(m, s, s, 3)"""
    target_backgrounds: NDArray[np.uint8]
    """(m, s, s, 3)"""
    target_cameras: tuple[Camera, ...]
    depths: NDArray[np.float32]
    """(n, s, s) z-depth of the input views, metres; 0 where there is no surface."""
    masks: NDArray[np.int8]
    """(n, s, s): -1 nothing, 0 table, i + 1 body i."""
    tsdf: NDArray[np.float32]
    """The fused TSDF (r, r, r) indexed [x, y, z], in [-1, 1]; -1 where not observed."""
    observed: NDArray[np.bool_]
    """(r, r, r)"""
    labels: GraspLabels
    distance: NDArray[np.float32] | None = None
    """The mesh distance (r, r, r): Euclidean, in units of the truncation, in [-1, 1], true everywhere.
    None in records of before it was stored."""
    trials: Trials | None = None
    """All grasps that were executed, those behind the labels among them; None where they were not kept."""
    stereo: NDArray[np.float32] | None = None
    """(n, s, s) z-depth of the input views as a stereo sensor measures it, metres; 0 where it measured
    nothing. None where there was no such sensor."""
    fused: NDArray[np.float32] | None = None
    """(g, r, r, r) grids as VGN reads them (`geometry.fusion.vgn_grid`), each of a few views of its own.
    None where nobody asked for them: benchmarks/add_fused.py adds them."""

    @property
    def has_photos(self) -> bool:
        """Whether the scene was photographed."""
        return len(self.images) > 0

    @property
    def kind(self) -> str:
        """ "single", "pile" or "packed"."""
        return self.scene.kind

    @property
    def seed(self) -> int:
        """The seed of the arrangement."""
        return self.scene.seed

    @property
    def materials(self) -> tuple[str, ...]:
        """ "diffuse", "specular" or "transparent", one per body."""
        return tuple(material.kind for material in self.scene.materials)

    @property
    def workspace(self) -> Workspace:
        """The cube that it is about. Raises `InputError` where the cell does not describe one."""
        return Workspace.from_dict(self.cell.get("workspace", {}), f"{self.name}: its workspace")

    def views(self, workspace: Workspace | None = None) -> Views:
        """What a detector may see of the record. Raises `InputError` where it has no photos."""
        return _views(self.images, self.backgrounds, self.cameras, workspace or self.workspace)

    def target_views(self, workspace: Workspace | None = None) -> Views:
        """The views from the hemisphere, for photometric losses. Raises `InputError` where there are none."""
        backgrounds = self.target_backgrounds
        return _views(self.targets, backgrounds, self.target_cameras, workspace or self.workspace)

    @property
    def truth(self) -> SceneTruth:
        """What the simulator knows of its surface and photos."""
        return SceneTruth(self.tsdf, self.observed, self.distance, self.fused, self.depths, self.masks)

    def grasp_scene(self) -> GraspScene:
        """What of it training may know."""
        return GraspScene(
            name=self.name,
            workspace=self.workspace,
            labels=self.labels,
            views=self.views() if self.has_photos else None,
            targets=self.target_views() if len(self.targets) else None,
            truth=self.truth,
            stereo=self.stereo,
        )


def without_photos() -> dict[str, Any]:
    """The fields of a `Record` that depend on its photos, where there are none."""
    photos = ("images", "backgrounds", "targets", "target_backgrounds")
    return {
        **{name: NO_PHOTOS for name in photos},
        "cameras": (),
        "target_cameras": (),
        "depths": np.zeros((0, 0, 0), np.float32),
        "masks": np.zeros((0, 0, 0), np.int8),
        "stereo": None,
    }


def write_record(folder: Path, record: Record) -> None:
    """Writes the record as `folder`, all of it or nothing; an existing complete folder stays as it is.

    The same record gives the same bytes. Raises `WriteError` where the disk refuses.
    """
    folder = Path(folder)
    with whole_folder(folder) as part:
        _write_files(part, record)


PhotosWanted = Literal["all", "inputs", "none"]
"""Which photos of a record are read."""


@told_as(DataError)
def read_record(folder: Path, photos: PhotosWanted = "all", trials: bool = True) -> Record:
    """The record in `folder`, with what of photos and trials is wanted.

    Raises `DataError` naming the file that is missing or damaged, and how the record is made again.
    """
    folder = Path(folder)
    try:
        return _read(folder, photos, trials)
    except InputError as error:
        again = f"delete {folder} and run `neugrasp generate` again as before: it makes what is missing"
        raise InputError(f"{error}; {again}") from error


def _read(folder: Path, photos: PhotosWanted, trials: bool) -> Record:
    need_files(folder, FILES)
    world = scene_from_json(
        (folder / "world.json").read_text(encoding="utf-8", errors="replace"), folder / "world.json"
    )
    cell = Fields(str(folder / "cell.json"), read_json(folder / "cell.json", "the work cell")).data
    truth = truth_from_bytes(read_bytes(folder / "truth.npz"), str(folder / "truth.npz"))
    record = Record(
        name=folder.name,
        scene=world,
        cell=cell,
        **(truth | (_photos(folder, photos) if cell.get("photos", True) else without_photos())),
        labels=labels_from_bytes(read_bytes(folder / LABELS_FILE), str(folder / LABELS_FILE)),
        trials=read_trials(folder) if trials else None,
    )
    check_record(record, str(folder))
    return record


def read_trials(folder: Path) -> Trials | None:
    """The trials of the record in `folder`, None where it has none. Raises `InputError` where damaged."""
    path = folder / TRIALS_FILE
    return trials_from_bytes(path.read_bytes(), str(path)) if path.is_file() else None


def need_files(folder: Path, files: tuple[str, ...]) -> None:
    for name in files:
        if not (folder / name).is_file():
            raise InputError(f"{folder / name}: missing; a record needs {', '.join(FILES + PHOTO_FILES)}")


def _photos(folder: Path, wanted: PhotosWanted) -> dict[str, Any]:
    """Photos, backgrounds and cameras, read."""
    need_files(folder, PHOTO_FILES)
    found = without_photos()
    if wanted == "none":
        return found
    inputs = read_scene(folder)
    found = {name: found[name] for name in found if name.startswith("target")} | {
        "images": _stacked(inputs, "image", folder / "images"),
        "backgrounds": _stacked(inputs, "background", folder / "backgrounds"),
        "cameras": tuple(view.camera for view in inputs.frames),
    }
    if wanted == "inputs":
        return found
    targets = read_scene(folder / "targets")
    return found | {
        "targets": _stacked(targets, "image", folder / "targets" / "images"),
        "target_backgrounds": _stacked(targets, "background", folder / "targets" / "backgrounds"),
        "target_cameras": tuple(view.camera for view in targets.frames),
    }


def check_record(record: Record, source: str) -> None:
    """Raises `InputError` naming `source` where the parts of a record do not fit together."""
    n, height, width = record.images.shape[:3]
    resolution = record.workspace.resolution
    expected = {
        "depth": (record.depths.shape, (n, height, width)),
        "masks": (record.masks.shape, (n, height, width)),
        "tsdf": (record.tsdf.shape, (resolution,) * 3),
        "observed": (record.observed.shape, (resolution,) * 3),
        "materials": ((len(record.scene.materials),), (len(record.scene.bodies),)),
    }
    if record.stereo is not None:
        expected["stereo"] = (record.stereo.shape, (n, height, width))
    if record.fused is not None:
        expected["fused"] = (record.fused.shape[1:], (resolution,) * 3)
    if record.distance is not None:
        expected["distance"] = (record.distance.shape, (resolution,) * 3)
    for name, (shape, wanted) in expected.items():
        if shape != wanted:
            raise InputError(f"{source}: {name} has shape {shape}; it must be {wanted}")


def _write_files(folder: Path, record: Record) -> None:
    if record.has_photos:
        write_scene(folder, record.views())
        write_scene(folder / "targets", record.target_views())
    (folder / "world.json").write_text(scene_to_json(record.scene) + "\n", encoding="utf-8")
    (folder / "cell.json").write_text(
        json.dumps(record.cell, indent=1, sort_keys=True) + "\n", encoding="utf-8"
    )
    (folder / "truth.npz").write_bytes(truth_to_bytes(record.truth, record.stereo))
    (folder / LABELS_FILE).write_bytes(labels_to_bytes(record.labels))
    if record.trials is not None:
        (folder / TRIALS_FILE).write_bytes(trials_to_bytes(record.trials))


def _views(
    images: NDArray[np.uint8],
    backgrounds: NDArray[np.uint8],
    cameras: tuple[Camera, ...],
    workspace: Workspace,
) -> Views:
    triples = zip(images, backgrounds, cameras, strict=True)
    return Views(tuple(View(camera, image, background) for image, background, camera in triples), workspace)


def _stacked(views: Views, field: str, source: Path) -> NDArray[np.uint8]:
    images = [getattr(view, field) for view in views.frames]
    if len({image.shape for image in images}) != 1:
        raise InputError(f"{source}: images of several sizes; those of a record are all of one size")
    return np.stack(images)
