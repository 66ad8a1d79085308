"""A stereo sensor beside the photos: where it stands, at whose pixels its depth is, what generate stores."""

from __future__ import annotations

import importlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from neugrasp.data.packing import pack
from neugrasp.data.records import read_record
from neugrasp.data.shards import Shards
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import FOCAL, view_set
from neugrasp.geometry.workspace import USUAL
from neugrasp.observation import DepthView
from neugrasp.simulation.command import Generate
from neugrasp.simulation.generate import generate
from neugrasp.simulation.stereo_sensor import SCALE, at_pixels_of, half_sensor, sensor_around


@pytest.fixture
def scene_renderer(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> type:
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "cache"))
    monkeypatch.syspath_prepend(Path(__file__).parent)
    return importlib.import_module("noise_renderer").NoiseRenderer


def whole() -> Camera:
    return view_set("released", USUAL, np.random.default_rng(0))[0]


def crop(size: int = 128) -> Camera:
    camera = whole()
    return camera.cropped_and_resized(USUAL.photo_box(camera), size, size)


def test_the_sensor_of_a_crop_is_as_fine_as_that_of_the_whole_photo():
    sensor, of_whole = sensor_around(crop()), half_sensor(whole())
    np.testing.assert_array_equal(sensor.world_from_camera, of_whole.world_from_camera)
    assert sensor.intrinsics[0, 0] == pytest.approx(SCALE * FOCAL, rel=0.01)
    assert sensor.intrinsics[0, 0] == pytest.approx(of_whole.intrinsics[0, 0], rel=0.01)
    corners, _ = sensor.project(crop().unproject([[0, 0], [127, 127]], [1.0, 1.0]))
    assert (corners[0] > (sensor.width / 4 - 1, -1)).all()
    assert (corners[1] < (3 * sensor.width / 4, sensor.height)).all()


def test_depth_is_read_at_the_pixels_of_the_photo():
    camera, sensor = crop(), sensor_around(crop())
    tilted = (0.4 + 1e-4 * sensor.pixel_grid() @ [3.0, 1.0]).astype(np.float32)
    depth = at_pixels_of(camera, DepthView(sensor, depth=tilted))
    pixels, _ = sensor.project(camera.unproject(camera.pixel_grid(), np.ones((128, 128))))
    left, top, right, bottom = camera.bounds
    u, v = np.moveaxis(camera.pixel_grid(), -1, 0)
    inside = (u > left) & (u < right) & (v > top) & (v < bottom)
    assert (depth[~inside] == 0).all()
    expected = 0.4 + 1e-4 * pixels @ [3.0, 1.0]
    np.testing.assert_allclose(depth[inside], expected[inside], atol=2.1e-4)


def test_beside_what_the_sensor_sees_there_is_nothing():
    camera = replace(crop(), sensed=None)
    half = camera.cropped_and_resized((-0.5, -0.5, 63.5, 127.5), 64, 128)
    depth = at_pixels_of(camera, DepthView(half, depth=np.full((128, 64), 0.5, np.float32)))
    assert (depth[:, :64] == 0.5).all()
    assert (depth[:, 64:] == 0).all()


def small(out: Path, **changes: object) -> Generate:
    plain = Generate(
        scene="packed", num=1, out=out, object_sets=("glassware",), grasp_points=2, image_size=32, seed=4,
        workers=1,
    )  # fmt: skip
    return replace(plain, **changes)  # type: ignore[arg-type]


@pytest.mark.slow
def test_generate_keeps_what_was_measured_beside_the_same_scene(scene_renderer: type, tmp_path: Path):
    (plain,) = generate(small(tmp_path / "plain"), scene_renderer)
    (stereo,) = generate(small(tmp_path / "stereo", stereo=True), scene_renderer)
    first, second = read_record(plain), read_record(stereo)
    assert first.stereo is None
    assert second.stereo is not None
    assert second.stereo.shape == second.depths.shape
    for name in ("images", "backgrounds", "depths", "tsdf"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    assert json.loads((tmp_path / "stereo" / "dataset.json").read_text())["stereo"] is True
    assert "stereo" not in json.loads((tmp_path / "plain" / "dataset.json").read_text())
    pack([tmp_path / "stereo" / "scenes"], tmp_path / "light", quality=80)
    packed = Shards(tmp_path / "light").read(0)
    np.testing.assert_array_equal(packed.stereo, second.stereo)
    np.testing.assert_array_equal(packed.depths, second.depths)


def test_stereo_needs_photos(tmp_path: Path):
    with pytest.raises(InputError, match="--stereo: depth is measured beside photos"):
        generate(small(tmp_path, stereo=True, photos=False))
