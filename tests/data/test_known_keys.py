"""Keys that bend geometry are refused unless they say that nothing is bent; others are named."""

from __future__ import annotations

import logging
import re
from typing import Any

import numpy as np
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
    # Letters of other alphabets and accents, where Latin ones are meant.
    "\u043a1": 0.1,
    "\u03ba1": 0.1,
    "dist\u043ertion": [0.1],
    "dist\u00f3rtion": [0.1],
    "fi\u0455heye": True,
    "applied_s\u0441ale": 0.5,
    "\U0001d424\u2081": 0.1,
    # Misspelt.
    "distorsion": [0.1],
    "disortion": [0.1],
    "distorition_coefficients": [0.1],
    "roling_shutter": 0.03,
    "aplied_scale": 0.8,
    "fishey": True,
    # Other spellings and other programs.
    "disto_k3": [0.1, 0, 0],
    "cam_dist": [0.1],
    "lens_params": {"k": [0.1]},
    "undistort_params": [0.1],
    "calibration_coeffs": [0.1],
    "brown_conrady": [0.1],
    "pincushion": 0.1,
    "tau_x": 0.01,
    "refractive_index": 1.33,
    "camera": "fisheye",
    "optics": "GoPro fisheye",
    "proj_type": "equidistant",
    "pixel_aspect_ratio": 1.07,
    "shift_x": 0.1,
    "principal_point_offset": [3, 4],
    "digital_zoom": 2.0,
    "center_crop": [1, 2, 3, 4],
    "is_cropped": True,
    "upside_down": True,
    "vflip": True,
    "image_rot": 90,
    "downsampling": 2,
    "intrinsics_scale": 0.5,
    "calib_size": [1280, 960],
    "linear_unit": "mm",
    "unit_of_length": "cm",
    "angle_unit": "degrees",
    "millimeters": True,
    "to_meters": 0.001,
    "colmap_scale": 0.5,
    "scaling_ratio": 0.5,
    "up_to_scale": True,
    "coord_system": "opengl",
    "coordinates": "blender",
    "handed": "left",
    "quat_order": "wxyz",
    "quaternion": "wxyz",
    "rotation_order": "zyx",
    "extrinsics_type": "w2c",
    "column_major": True,
    "is_opengl": True,
    "inverted": True,
    "tool_offset": [0, 0, 0.1],
    "tcp": [0, 0, 0.1, 0, 0, 0],
    "base_correction": [0.001, 0, 0],
    "undistorted": False,
    "is_rectified": "no",
    "is_metric": False,
    "global_shutter": False,
    "fl_x": 600.0,
    "camera_matrix": [[500, 0, 320], [0, 500, 240], [0, 0, 1]],
    "fov": 60.0,
    "readout": 0.03,
    "line_delay": 1e-5,
}
TURN = [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
POSES = {
    "world_from_base": TURN,
    "T_base_world": TURN[:3],
    "hand_eye": [number for row in TURN for number in row],
    "icp": {"translation": [0, 0, 0.1], "rotation": [0, 0, 0, 1]},
    "correction_by": {"xyz": [0, 0, 0.1], "rpy": [0, 0, 0]},
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
    "sensor_model": "OmniVision OV9281",
    "camera": "D435",
    "undistorted": True,
    "is_metric": True,
    "pixel_aspect_ratio": 1,
    "quaternion": "xyzw",
    "angle_unit": "rad",
    "extrinsics_type": "c2w",
    "tool_offset": [0, 0, 0],
    "distribution": [0.1, 0.2],
    "min_distance": 0.2,
    "aspect_ratio": 1.333,
    # As apps for phones and readers of theirs write them.
    "fps": 30,
    "near": 0.01,
    "far": 4.0,
    "blur_score": 83.1,
    "center_depth": 0.4,
    "manual_keyframe": False,
    "neighbors": [1, 2],
    "is_bad": False,
    "exposure_time": 0.01,
    "aabb": [[-1, -1, -1], [1, 1, 1]],
    "bbox": [10, 20, 300, 400],
    "split": "train",
    "box": TURN[0],
    "same": np.eye(4).tolist(),
}


@pytest.mark.parametrize("key", BENT)
def test_a_key_that_bends_geometry_is_refused_by_name(key: str):
    entry: dict[str, Any] = {"known": 1, key: BENT[key]}
    with pytest.raises(InputError, match=f"here: {re.escape(repr(key))} .*, which is not read here; "):
        refuse_bends(entry, ("known",), "here")
    refuse_bends(entry, ("known", key), "here")
    with pytest.raises(InputError, match=r"not read here; ask somebody"):
        refuse_bends(entry, ("known",), "here", "ask somebody")


@pytest.mark.parametrize("key", POSES)
def test_a_second_pose_is_refused_unless_it_is_one_that_is_read(key: str):
    entry: dict[str, Any] = {"world_from_camera": TURN, key: POSES[key]}
    with pytest.raises(InputError, match=f"{key!r} is a pose, which is not read here; .* '_{key}'"):
        refuse_bends({**entry, "world_from_camera": np.diag([-1, -1, 1, 1])}, ("world_from_camera",), "here")
    refuse_bends({f"_{key}": POSES[key]}, (), "here")
    if isinstance(POSES[key], list):
        inverse = np.linalg.inv(TURN).tolist()
        refuse_bends({**entry, "camera_from_world": inverse}, ("world_from_camera",), "here")


@pytest.mark.parametrize(
    "entry",
    [
        {"calibration": {"left": {"D": [0.1, 0]}}},
        {"cameras": {"0": {"optics": {"k1": 0.1}}}},
        {"meta": {"a": [{"b": {"distorsion": [0.1]}}]}},
    ],
)
def test_a_camera_in_objects_in_objects_is_seen(entry: dict[str, Any]):
    with pytest.raises(InputError, match="is a coefficient of lens distortion"):
        refuse_bends(entry, (), "here")
    refuse_bends({"calibration": {"depth": {"D": [0.1, 0]}, "note": "k1"}}, (), "here")


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


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("\u7578\u53d8", [0.1, 0, 0, 0, 0]),
        ("\u6bd4\u4f8b", 1.05),
        ("\u9c7c\u773c", True),
        ("\u955c\u5934", "fisheye"),
        ("\u955c\u5934", {"k": [0, 0.1]}),
        ("\u1d05\u026a\ua731\u1d1b", [0.1]),
        ("\uabafoeffs", [0.1]),
        ("\u03f3\u0576", -0.5),
        ("\uab6foeffs", [0.1]),
        ("\u05e2\u05d9\u05d5\u05d5\u05ea", "equirectangular"),
    ],
)
def test_what_nobody_here_can_read_is_no_note_where_it_holds_more_than_words(key: str, value: Any):
    with pytest.raises(InputError, match="is in letters that are not read here"):
        refuse_bends({key: value}, ("image",), "scene.json")
    refuse_bends({f"_{key}": value}, ("image",), "scene.json")


@pytest.mark.parametrize(
    "value", ["\u5de6\u8fb9", "2 cm", "", None, False, 0, [], {"\u5907\u6ce8": "a"}, [0, 0.0]]
)
def test_notes_in_any_letters_are_notes(value: Any):
    for key in ("\u5907\u6ce8", "\u26a0", "\u00fcbersicht"):
        refuse_bends({key: value}, ("image",), "scene.json")
