"""One lens under every name that programs give it, or a refusal that says which key is not understood."""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.importers.foreign_lens import lens_of
from neugrasp.importers.robot_poses import camera_of

MATRIX = [[520.0, 0, 321.0], [0, 524.0, 237.0], [0, 0, 1]]
FLAT = [number for row in MATRIX for number in row]
BENDS = [-0.18, 0.05, 0.001, -0.002, 0.01]
"""k1, k2, p1, p2, k3."""
SIZE = {"width": 640, "height": 480}
K1, K2, P1, P2, K3 = BENDS

SAME = {
    "ours": {"intrinsics": MATRIX, **SIZE, "distortion": BENDS},
    "ROS message": {"K": FLAT, **SIZE, "D": BENDS, "distortion_model": "plumb_bob"},
    "ROS file": {
        "image_width": 640,
        "image_height": 480,
        "camera_matrix": {"rows": 3, "cols": 3, "data": FLAT},
        "distortion_coefficients": {"rows": 1, "cols": 5, "data": BENDS},
        "rectification_matrix": {"rows": 3, "cols": 3, "data": [1, 0, 0, 0, 1, 0, 0, 0, 1]},
        "projection_matrix": {"rows": 3, "cols": 4, "data": [0.0] * 12},
        "distortion_model": "rational_polynomial",
    },
    "OpenCV": {"camera_matrix": MATRIX, "image_size": [640, 480], "dist_coeffs": [BENDS]},
    "OpenCV's column": {"mtx": 0, "K": MATRIX, **SIZE, "dist": [[value] for value in BENDS]},
    "OpenCV, rational": {"cameraMatrix": MATRIX, **SIZE, "distCoeffs": [*BENDS, 0, 0, 0]},
    "RealSense": {
        "intrinsics": {
            **SIZE,
            **{"ppx": 321.0, "ppy": 237.0, "fx": 520.0, "fy": 524.0, "coeffs": BENDS},
            "model": "Brown Conrady",
        }
    },
    "Orbbec": {
        "intrinsic": {"fx": 520.0, "fy": 524.0, "cx": 321.0, "cy": 237.0, **SIZE},
        "distortion": {"k1": K1, "k2": K2, "k3": K3, "k4": 0, "k5": 0, "k6": 0, "p1": P1, "p2": P2},
    },
    "single numbers": {
        **{"fx": 520.0, "fy": 524.0, "cx": 321.0, "cy": 237.0, "w": 640, "h": 480},
        **{"k1": K1, "k2": K2, "k3": K3, "p1": P1, "p2": P2},
    },
    "capitals": {"Intrinsics": MATRIX, "Width": 640, "HEIGHT": 480, "Distortion": BENDS},
}


@pytest.mark.parametrize("name", SAME)
def test_one_lens_under_every_name(name: str, caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        lens = camera_of(SAME[name], Path("camera.json"))
    np.testing.assert_array_equal(lens.intrinsics, MATRIX)
    assert (lens.width, lens.height) == (640, 480)
    np.testing.assert_array_equal(lens.coefficients, BENDS)
    assert ("not known" in caplog.text) == ("mtx" in SAME[name])


OURS: dict[str, Any] = {"intrinsics": MATRIX, **SIZE}
REFUSED = {
    "a fisheye": ({"distortion_model": "equidistant", "D": [0.1, 0, 0, 0]}, "distortion_model 'equidistant'"),
    "Kannala and Brandt": ({"camera_model": "KANNALA_BRANDT"}, "camera_model 'KANNALA_BRANDT'"),
    "FTheta": ({"ftheta_p0": 0.1}, "'ftheta_p0' is a lens that is no pinhole"),
    "a sphere": ({"projection": "equirectangular"}, "projection 'equirectangular'"),
    "is_fisheye": ({"is_fisheye": True}, "is_fisheye cannot be undistorted"),
    "inverse": (
        {"model": "distortion.inverse_brown_conrady", "coeffs": BENDS},
        "model 'distortion.inverse_brown_conrady'",
    ),
    "rational": ({"D": [*BENDS, 0.1, 0, 0]}, r"D: must be \[k1, k2, p1, p2, k3\]"),
    "thin prism": ({"distortion": [*BENDS, 0, 0, 0, 0.1, 0, 0, 0]}, "distortion: must be"),
    "three numbers": ({"distortion": [0.1, 0.0, 0.01]}, "distortion: must be"),
    "k4": ({"k1": 0.1, "k4": 0.01}, "k4 cannot be undistorted"),
    "s1": ({"s1": 0.01}, "s1 cannot be undistorted"),
    "another spelling": ({"lensDistortionParams": BENDS}, "'lensDistortionParams' is a coefficient"),
    "of the colour camera": ({"rgbDistortion": {"k1": 0.1}}, "'rgbDistortion' is a coefficient"),
    "radial alone": ({"radial_distortion": [0.1, 0]}, "'radial_distortion' is a coefficient"),
    "rolling shutter": ({"rolling_shutter": [0, 0, 0.1, 0]}, "'rolling_shutter' is a camera that moves"),
    "cropped": ({"roi": {"x_offset": 20}}, "'roi' is a change of the photo"),
    "binned": ({"binning_x": 2}, "'binning_x' is a change of the photo"),
    "rectified": ({"R": [0, 1, 0, -1, 0, 0, 0, 0, 1]}, "'R' is a change of the photo"),
    "nerfstudio's list of five": ({"distortion_params": BENDS}, "5 numbers; nerfstudio's are"),
    "two lists": ({"D": BENDS, "distortion": [0] * 5}, "'D' and 'distortion' say the same differently"),
    "two focal lengths": ({"fl_x": 400.0}, "'intrinsics' and 'fl_x' say different focal lengths"),
    "two middles": ({"cx": 300.0}, "'cx' and 'intrinsics' say different principal points"),
    "words": ({"distortion": "a little"}, "distortion: of another shape or type"),
    "list and number": ({"distortion": BENDS, "k1": 0.3}, "says another distortion than k1"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_not_understood_is_refused_by_name(name: str):
    more, message = REFUSED[name]
    with pytest.raises(InputError, match=message) as caught:
        camera_of({**OURS, **more}, Path("camera.json"))
    assert "camera.json" in str(caught.value)


@pytest.mark.parametrize(
    "more",
    [
        {"model": "distortion.inverse_brown_conrady", "coeffs": [0.0] * 5},
        {"distortion_model": "none"},
        {"D": []},
        {"distortion": None},
        {"is_fisheye": False, "rolling_shutter": [0, 0, 0, 0], "binning_x": 0},
        {"model": "Intel RealSense D435"},
    ],
)
def test_a_straight_lens_may_say_so(more: dict[str, Any]):
    assert not camera_of({**OURS, **more}, Path("camera.json")).is_distorted


W, H = 640, 480
ANGLE = 2 * np.arctan(W / 2 / 608)
WAYS = {
    "fl_x": {"fl_x": 608.0},
    "fl_x and fl_y": {"fl_x": 608.0, "fl_y": 608.0},
    "fl_y alone": {"fl_y": 608.0},
    "camera_angle_x": {"camera_angle_x": ANGLE},
    "x_fov": {"x_fov": np.rad2deg(ANGLE)},
    "intrinsics": {"intrinsics": [[608.0, 0, 320], [0, 608, 240], [0, 0, 1]]},
    "K": {"K": [608.0, 0, 320, 0, 608, 240, 0, 0, 1]},
}
OTHERS = {
    "fl_x": {"fl_x": 520.0, "fl_y": 520.0},
    "camera_angle_x": {"camera_angle_x": 2 * np.arctan(W / 2 / 520)},
    "intrinsics": {"intrinsics": [[520.0, 0, 320], [0, 520, 240], [0, 0, 1]]},
}


@pytest.mark.parametrize("frame", WAYS)
@pytest.mark.parametrize("file", OTHERS)
def test_a_photos_own_focal_length_wins_however_it_is_written(frame: str, file: str):
    lens = lens_of(WAYS[frame], "frame 0", True, file={**OTHERS[file], "w": W, "h": H})
    np.testing.assert_allclose(lens.intrinsics, [[608, 0, 319.5], [0, 608, 239.5], [0, 0, 1]])


@pytest.mark.parametrize(
    "own", [{"w": 640, "h": 480}, {"width": 640, "height": 480}, {"image_size": [640, 480]}]
)
@pytest.mark.parametrize("file", [{"w": 960, "h": 720}, {"width": 960, "height": 720}])
def test_a_photos_own_size_wins_however_it_is_written(own: dict, file: dict):
    lens = lens_of({**own, "camera_angle_x": ANGLE}, "frame 0", True, file={**file, "fl_x": 912.0})
    assert (lens.width, lens.height) == (640, 480)
    assert lens.intrinsics[0, 0] == pytest.approx(608)


@pytest.mark.parametrize(
    ("own", "file", "expected"),
    [
        ({"k1": 0.1}, {"distortion_params": [0.2, 0, 0, 0, 0, 0]}, (0.1, 0, 0, 0, 0)),
        (
            {"distortion_params": [0.1, 0.2, 0.3, 0, 0.4, 0.5]},
            {"k1": 0.9, "p1": 0.9},
            (0.1, 0.2, 0.4, 0.5, 0.3),
        ),
        ({"D": [0.1, 0, 0, 0, 0]}, {"distortion_params": [0.2, 0, 0, 0, 0, 0]}, (0.1, 0, 0, 0, 0)),
        ({"distortion": [0.1, 0.2, 0.3, 0.4]}, {"k3": 0.9}, (0.1, 0.2, 0.3, 0.4, 0)),
        ({"k1": 0.0}, {"k1": 0.2, "k2": 0.3}, (0, 0.3, 0, 0, 0)),
        ({}, {"distortion_coefficients": [0.1]}, (0.1, 0, 0, 0, 0)),
    ],
)
def test_a_photos_own_distortion_wins_however_it_is_written(own: dict, file: dict, expected: tuple):
    common = {"fl_x": 600.0, "w": 640, "h": 480, **file}
    np.testing.assert_array_equal(lens_of(own, "frame 0", True, file=common).coefficients, expected)


def test_a_photos_own_model_wins():
    common = {"fl_x": 600.0, "w": 640, "h": 480, "camera_model": "OPENCV_FISHEYE"}
    assert not lens_of({"camera_model": "PINHOLE"}, "frame 0", file=common).is_distorted
    with pytest.raises(InputError, match="camera_model 'OPENCV_FISHEYE'"):
        lens_of({}, "frame 0", file=common)
    with pytest.raises(InputError, match="camera_model 'EQUIRECTANGULAR'"):
        lens_of({"camera_model": "EQUIRECTANGULAR"}, "frame 0", file={**common, "camera_model": "PINHOLE"})


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ({"camera_angle_x": 60.0}, "'camera_angle_x' is 60; it must be in radians"),
        ({"camera_angle_x": 0}, "'camera_angle_x' is 0; it must be in radians"),
        ({"x_fov": 200}, "'x_fov' is 200; it must be in degrees"),
        ({"fl_x": -600.0}, "'fl_x' is -600; it must be positive"),
        ({"fl_x": "600"}, "'fl_x' is '600'; it must be a number"),
        ({"fl_x": 10**29}, "no length and no pixel"),
        ({"fl_x": 600.0, "camera_angle_x": 0.5}, "'fl_x' and 'camera_angle_x' say different focal lengths"),
        ({"K": [[600, 30, 320], [0, 600, 240], [0, 0, 1]]}, "not a camera matrix without skew"),
        ({"K": [[600, 0, 0], [0, 600, 0], [320, 240, 1]]}, "not a camera matrix"),
        ({}, "no focal length; give 'intrinsics'"),
    ],
)
def test_a_focal_length_that_is_none_is_named(entry: dict, message: str):
    with pytest.raises(InputError, match=message):
        lens_of({"w": 640, "h": 480, **entry}, "frame 0", True)
