"""The bundled scenes: photos that the generator rendered of objects that no weights were trained on."""

from __future__ import annotations

from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import numpy as np

from neugrasp.data.npz import npz_arrays
from neugrasp.data.scene_folder import read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.contract import Detection, Detector
from neugrasp.detection.files import FILES
from neugrasp.errors import InputError
from neugrasp.observation import Observation
from neugrasp.pictures import slice_picture, surface_sheet, write_picture


@dataclass(frozen=True)
class DemoScene:
    """One bundled scene."""

    name: str
    folder: Path


def demo_scenes() -> list[DemoScene]:
    """The bundled scenes by name."""
    root = Path(str(resources.files("neugrasp"))) / "demo" / "scenes"
    folders = sorted(file.parent for file in root.glob("*/scene.json"))
    if not folders:
        raise InputError(f"{root}: no bundled scenes; this installation is incomplete")
    return [DemoScene(folder.name, folder) for folder in folders]


def run_demo(scene: DemoScene, detector: Detector[Observation], out: Path) -> Detection:
    """Predicts a scene and writes its four files, surface.png and slice.png into `out`."""
    with whole_or_nothing(out, FILES) as part:
        views = read_scene(scene.folder)
        detection = detector.detect(views)
        truth = _truth(scene.folder / "truth.npz")
        detection.write(part, views)
        if detection.tsdf is not None:
            write_picture(part / "surface.png", surface_sheet(views, detection.tsdf, truth))
            write_picture(part / "slice.png", slice_picture(detection.tsdf, views.workspace))
    return detection


def _truth(file: Path) -> np.ndarray | None:
    """The true grid that the generator fused from depth images, where the scene has one."""
    if not file.exists():
        return None
    return npz_arrays(file.read_bytes(), {"tsdf": "f"}, str(file))["tsdf"].astype(np.float32)
