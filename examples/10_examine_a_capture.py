"""A capture examined before anything is predicted, and mended where the cause is certain.

    python examples/10_examine_a_capture.py

A bundled scene is spoilt in the two most frequent ways: its poses are written in OpenGL's convention (y up, z
backwards), which gives no grasps and no error elsewhere, and one background is shifted by two pixels, as if
the camera had been touched. The doctor finds both. The poses it can put right, as only one convention lets
the cameras see the table; a photo from another place it cannot, so that stays red and says what to do. As
commands, on a scene folder of yours:

    neugrasp doctor my_scene --report doctor.html
    neugrasp doctor my_scene --fix my_scene_fixed
    neugrasp predict my_scene_fixed --out out --report
    neugrasp view out
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro

from neugrasp.data.scene_folder import read_scene
from neugrasp.demo.bundled import demo_scenes
from neugrasp.doctor.capture import Capture
from neugrasp.doctor.examination import examine
from neugrasp.doctor.findings import Level
from neugrasp.observation import View, Views

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


def main(scene: Path | None = None) -> None:
    """Spoils a scene and examines it; without --scene, the first of the bundled ones."""
    good = read_scene(scene or demo_scenes()[0].folder)
    spoilt = replace(good, frames=tuple(in_opengl(view) for view in good.frames))
    print("The poses in OpenGL's convention:")
    mended = tell(spoilt)
    if mended is not None:
        error = max(
            np.abs(mine.camera.world_from_camera - yours.camera.world_from_camera).max()
            for mine, yours in zip(mended.frames, good.frames, strict=True)
        )
        print(f"  mended: the poses are the good ones again, to {error:.1e}")
    first, *rest = good.frames
    moved = replace(first, background=np.roll(first.background, 2, axis=1))
    print("A background shifted by two pixels:")
    tell(replace(good, frames=(moved, *rest)))


def in_opengl(view: View) -> View:
    """The view with its pose as OpenGL and Blender write it."""
    pose = view.camera.world_from_camera @ OPENCV_FROM_OPENGL
    return replace(view, camera=replace(view.camera, world_from_camera=pose))


def tell(views: Views) -> Views | None:
    """Prints what is wrong with a capture; the mended one, where the doctor is certain."""
    diagnosis = examine(Capture.of(views))
    for line in diagnosis.lines(Level.YELLOW):
        print(f"  {line}")
    mended = diagnosis.capture if diagnosis.is_mended else None
    return None if mended is None else mended.views


if __name__ == "__main__":
    tyro.cli(main)
