"""Keys that bend geometry are refused unless they say that nothing is bent; others are named."""

from __future__ import annotations

import logging
from typing import Any

import pytest

from neugrasp.data.known_keys import refuse_bends, warn_of_unknown
from neugrasp.errors import InputError

BENT = {
    "distortion": [-0.1, 0, 0, 0, 0],
    "distortion_params": [0, 0, 0, 0.1, 0, 0],
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [-0.1, 0, 0, 0, 0]},
    "distortionCoefficients": [0.1],
    "dist_coeffs": [[-0.1, 0, 0, 0, 0]],
    "dist": [0.1],
    "DistCoeffs": [0.1],
    "D": [0.1, 0, 0, 0],
    "coeffs": [0.1, 0, 0, 0, 0],
    "kc": [0.1],
    "k1": 0.1,
    "K4": 1e-3,
    "p2": 0.001,
    "radial_distortion": [0.1],
    "tangential_distortion": [0.1],
    "lens_distortion": {"k1": 0.1},
    "rgb_distortion": {"k1": 0.1, "k2": 0.0},
    "distortion_model": "equidistant",
    "lens_model": "kannala_brandt",
    "camera_model": "OPENCV_FISHEYE",
    "camera_type": "equirectangular",
    "projection": "spherical",
    "is_fisheye": True,
    "fisheye": {"k1": 0.1},
    "ftheta_p0": 0.3,
    "latlong": True,
    "xi": 0.9,
    "rolling_shutter": [0, 0, 0.01, 0],
    "rolling_shutter_readout": 0.03,
    "transform_matrix_start": [[1, 0, 0, 0.5], [0, 1, 0, 0], [0, 0, 1, 0]],
    "applied_scale": 0.8,
    "applied_transform": [[0, 1, 0, 0], [1, 0, 0, 0], [0, 0, -1, 0]],
    "scale": 0.001,
    "units": "mm",
    "length_unit": "inch",
    "position_mm": [1, 2, 3],
    "camera_convention": "opengl",
    "from_na": True,
    "quaternion_order": "wxyz",
    "crop": [0, 0, 100, 100],
    "roi": {"x_offset": 10, "width": 100},
    "binning_x": 2,
    "downscale_factor": 4,
    "rectification_matrix": [[0.9, 0.1, 0], [-0.1, 0.9, 0], [0, 0, 1]],
    "R": [0.9, 0.1, 0, -0.1, 0.9, 0, 0, 0, 1],
    "skew": 3.0,
}
STRAIGHT = {
    "distortion": [0, 0, 0, 0, 0],
    "distortion_coefficients": {"rows": 1, "cols": 5, "data": [0.0] * 5},
    "dist_coeffs": [[0.0], [0.0]],
    "D": [],
    "k1": 0,
    "k2": None,
    "distortion_model": "plumb_bob",
    "lens_model": "Pinhole",
    "camera_model": "OPENCV",
    "model": "RealSense D435",
    "is_fisheye": False,
    "latlong": False,
    "rolling_shutter": [0, 0, 0, 0],
    "shutter": "global",
    "applied_scale": 1,
    "scale": 1.0,
    "units": "metres",
    "camera_convention": "OpenCV",
    "quaternion_order": "xyzw",
    "binning_x": 1,
    "roi": {"x_offset": 0, "y_offset": 0, "width": 0, "height": 0},
    "R": [1, 0, 0, 0, 1, 0, 0, 0, 1],
    "rectification_matrix": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "skew": 0.0,
    "focal_length_mm": 3.67,
    "distance": 0.5,
    "name": "a scene",
    "depth_scale": 0.001,
    "comment": "distortion was removed",
}


@pytest.mark.parametrize("key", BENT)
def test_a_key_that_bends_geometry_is_refused_by_name(key: str):
    entry: dict[str, Any] = {"known": 1, key: BENT[key]}
    with pytest.raises(InputError, match=rf"here: '{key}' is .*, which is not read here; "):
        refuse_bends(entry, ("known",), "here")
    refuse_bends(entry, ("known", key), "here")
    with pytest.raises(InputError, match=r"not read here; ask somebody"):
        refuse_bends(entry, ("known",), "here", "ask somebody")


def test_a_key_that_says_that_nothing_is_bent_passes():
    for key, value in STRAIGHT.items():
        refuse_bends({key: value}, (), "here")


def test_an_unknown_key_is_named_once_with_the_nearest_known_one(caplog: pytest.LogCaptureFixture):
    logger = logging.getLogger("test")
    known = ("world_from_camera", "image", "background")
    entries = [
        {"image": 1, "world_from_camra": 2, "note": 3, "_remark": 4},
        {"Image": 1, "world_from_camra": 2},
    ]
    with caplog.at_level(logging.WARNING):
        warn_of_unknown(entries, known, "file", logger)
    assert [record.getMessage() for record in caplog.records] == [
        "file: the key 'world_from_camra' is not known and ignored; did you mean 'world_from_camera'?",
        "file: the key 'note' is not known and ignored",
        "file: the key 'Image' is not known and ignored; did you mean 'image'?",
    ]


@pytest.mark.parametrize("key", sorted(BENT))
def test_what_is_refused_is_not_called_ignored(key: str, caplog: pytest.LogCaptureFixture):
    warn_of_unknown(
        [{"frame": 1, key: BENT[key], "colour": 2}], ("frame",), "a.json", logging.getLogger("test")
    )
    assert [record.args[1] for record in caplog.records] == ["colour"]
