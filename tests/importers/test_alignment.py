"""The scale and the place of a reconstruction, from cameras known in both frames."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from foreign_formats import Similarity
from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array, from_quaternion, look_at, rigid, rotation_about
from neugrasp.importers.alignment import align, read_alignment
from neugrasp.observation import Views

quaternions = st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: float(np.linalg.norm(q)) > 0.1)
shifts = st.tuples(*[st.floats(-5, 5)] * 3)


def arc(count: int) -> list[Array]:
    """Cameras half a metre around the origin."""
    return [look_at((0.4 * np.cos(a), 0.4 * np.sin(a), 0.3), (0, 0, 0)) for a in np.linspace(0, 1, count)]


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(quaternions, shifts, st.floats(0.01, 100), st.integers(2, 8))
def test_any_similarity_is_found(quaternion: tuple, shift: tuple, scale: float, count: int):
    similarity = Similarity(scale, from_quaternion(quaternion, shift))
    cameras = arc(count)
    found = align([similarity.unmetric(camera) for camera in cameras], cameras)
    assert found.metres_per_unit == pytest.approx(scale, rel=1e-6)
    np.testing.assert_allclose(found.world_from_reconstruction, from_quaternion(quaternion, shift), atol=1e-6)
    assert found.residual < 1e-6


def test_noise_averages_out(rng: np.random.Generator):
    similarity = Similarity(3.0, rigid(rotation_about((1, 1, 0), 0.7), (0.1, 0.2, 0.3)))
    cameras = arc(8)
    noisy = [
        camera @ rigid(rotation_about(rng.normal(size=3), 0.002), rng.normal(size=3) * 1e-3)
        for camera in cameras
    ]
    found = align([similarity.unmetric(camera) for camera in cameras], noisy)
    assert found.metres_per_unit == pytest.approx(3.0, rel=0.01)
    assert 0 < found.residual < 0.005


def test_cameras_that_do_not_fit_are_refused():
    cameras = arc(4)
    with pytest.raises(InputError, match="seen in 1 of the photos; at least 2"):
        align(cameras[:1], cameras[:1])
    with pytest.raises(InputError, match="taken from one place"):
        align(cameras[:1] * 3, cameras[:1] * 3)
    moved = [*cameras[:3], rigid(translation=(0, 0.2, 0)) @ cameras[3]]
    with pytest.raises(InputError, match="do not fit together"):
        align(cameras, moved)
    with pytest.raises(InputError, match="do not fit together"):
        align([Similarity(2.0).unmetric(camera) for camera in cameras], cameras, has_unit=True)
    assert align(cameras[:1], cameras[:1], has_unit=True).metres_per_unit == 1


def test_the_file_says_the_same(tmp_path: Path, small_views: Views):
    similarity = Similarity(0.5, rigid(rotation_about((0, 1, 0), 0.3), (1, 2, 3)))
    file = similarity.write(tmp_path / "alignment.json", small_views)
    alignment, workspace = read_alignment(file)
    assert alignment.metres_per_unit == 0.5
    np.testing.assert_allclose(
        alignment.world_from_reconstruction, similarity.world_from_reconstruction, atol=1e-12
    )
    np.testing.assert_array_equal(workspace.world_from_workspace, np.eye(4))
    for key, value, message in (
        ("metres_per_unit", 0, "metres_per_unit is 0; it must be positive"),
        ("world_from_workspace", None, "world_from_workspace: missing"),
        ("world_from_reconstruction", [[2, 0], [0, 2]], "world_from_reconstruction: of another shape"),
    ):
        data = {**json.loads(file.read_text()), key: value}
        (tmp_path / "wrong.json").write_text(json.dumps(data))
        with pytest.raises(InputError, match=rf"wrong\.json: {message}"):
            read_alignment(tmp_path / "wrong.json")
