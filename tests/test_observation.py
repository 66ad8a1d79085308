"""What a detector is handed is checked once, where it is made."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import (
    MAX_VIEWS,
    DepthView,
    DepthViews,
    Frame,
    Observation,
    View,
    Views,
    with_backgrounds,
    with_depth,
)

WORKSPACE = Workspace()
INTRINSICS = np.array([[40.0, 0, 15.5], [0, 40.0, 11.5], [0, 0, 1]])
CAMERA = Camera(INTRINSICS, look_at((0.5, 0.15, 0.5), WORKSPACE.centre), 32, 24)
PHOTO = np.zeros((24, 32, 3), np.uint8)
DEPTH = np.ones((24, 32), np.float32)


@pytest.mark.parametrize(
    ("pictures", "words"),
    [
        ({"image": PHOTO[:, :, 0]}, r"its photo is uint8 \(24, 32\); its camera takes \(24, 32, 3\)"),
        ({"image": PHOTO[:-1]}, r"\(23, 32, 3\)"),
        ({"image": PHOTO.astype(float)}, "float64"),
        ({"image": PHOTO, "background": PHOTO.transpose(1, 0, 2)}, "its photo of the empty table"),
        ({"depth": DEPTH[..., None]}, "its depth image"),
        ({"depth": (1000 * DEPTH).astype(np.uint16)}, "metres as floats"),
    ],
)
def test_a_picture_is_of_its_camera(pictures: dict[str, np.ndarray], words: str):
    with pytest.raises(InputError, match=f"left.png: .*{words}"):
        Frame(CAMERA, **pictures, name="left.png")


def test_frames_of_a_scene_see_the_same():
    both, photo = Frame(CAMERA, PHOTO, PHOTO), Frame(CAMERA, PHOTO)
    with pytest.raises(InputError, match="view 1 has photo, view 0 has photo and photo of the empty table"):
        Observation((both, photo), WORKSPACE)
    with pytest.raises(InputError, match="view 0 has no picture"):
        Observation((Frame(CAMERA),), WORKSPACE)
    for count in (0, MAX_VIEWS + 1):
        with pytest.raises(InputError, match="1 to 8 views"):
            Observation((photo,) * count, WORKSPACE)


def test_an_algorithm_on_photos_names_what_it_lacks():
    seen = Observation((Frame(CAMERA, PHOTO),) * 2, WORKSPACE, source="shelf")
    with pytest.raises(InputError, match="shelf: has photo, and no photo of the empty table"):
        with_backgrounds(seen)
    with pytest.raises(InputError, match="no depth image"):
        with_depth(seen)


def test_what_is_there_is_handed_on_whole():
    frame = Frame(CAMERA, PHOTO, PHOTO + 1, DEPTH, stamp=3.5, name="left.png")
    seen = Observation((frame,), WORKSPACE, source="shelf")
    views, depths = with_backgrounds(seen), with_depth(seen)
    assert isinstance(views.frames[0], View)
    assert isinstance(depths.frames[0], DepthView)
    for narrow in (views, depths):
        assert (narrow.source, narrow.workspace) == ("shelf", WORKSPACE)
        for field in ("camera", "image", "background", "depth", "stamp", "name"):
            assert getattr(narrow.frames[0], field) is getattr(frame, field), field


def test_typed_observations_pass_as_they_are():
    views = Views((View(CAMERA, PHOTO, PHOTO),), WORKSPACE)
    depths = DepthViews((DepthView(CAMERA, depth=DEPTH),), WORKSPACE)
    assert with_backgrounds(views) is views
    assert with_depth(depths) is depths
    assert views.channels == {"image", "background"}
    with pytest.raises(InputError, match="its photo is"):
        replace(views.frames[0], image=PHOTO[:3])
