"""What is drawn in space lies where the camera sees it."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from neugrasp.figures.space import OVERSAMPLING, Canvas, homography
from neugrasp.figures.sphere import eye_that_sees, from_spherical, spherical, way_between
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace

WHITE = (255, 255, 255)


@pytest.fixture
def camera(cameras: list[Camera]) -> Camera:
    """The first one of the arc, 160 x 90."""
    return cameras[0].cropped_and_resized((-0.5, -0.5, 639.5, 359.5), 160, 90)


def blank(camera: Camera) -> Canvas:
    shape = (camera.height * OVERSAMPLING, camera.width * OVERSAMPLING, 3)
    return Canvas(np.zeros(shape, dtype=np.uint8), camera)


def test_a_photo_held_before_its_own_camera_fills_the_picture(camera: Camera, rng: np.random.Generator):
    columns, rows = np.meshgrid(np.linspace(0, 255, 160), np.linspace(0, 255, 90))
    photo = np.stack([columns, rows, np.full_like(rows, 128)], axis=-1).astype(np.uint8)
    corners = np.array([(-0.5, -0.5), (159.5, -0.5), (159.5, 89.5), (-0.5, 89.5)])
    canvas = blank(camera)
    canvas.photo(photo, camera.unproject(corners, np.full(4, 0.2)))
    drawn = canvas.image()
    assert np.abs(drawn[2:-2, 2:-2].astype(int) - photo[2:-2, 2:-2]).max() <= 4


def test_a_line_is_where_its_points_project_to(camera: Camera, workspace: Workspace):
    ends = workspace.centre + np.array([(-0.05, 0.02, 0), (0.06, -0.03, 0.04)])
    canvas = blank(camera)
    canvas.line(ends, WHITE, 3)
    lit = np.argwhere(canvas.image()[..., 0] > 128)[:, ::-1]
    pixels, _ = camera.project(ends)
    along = (pixels[1] - pixels[0]) / np.linalg.norm(pixels[1] - pixels[0])
    across = (lit - pixels[0]) @ (along[1], -along[0])
    assert len(lit) > 30
    assert np.abs(across).max() < 2.5
    assert np.abs(across.mean()) < 0.5


def test_what_lies_behind_the_camera_is_left_out(camera: Camera):
    behind = camera.unproject(np.array([(0.0, 0.0), (159.0, 0.0), (159.0, 89.0), (0.0, 89.0)]), -np.ones(4))
    canvas = blank(camera)
    canvas.line(behind, WHITE, 3)
    canvas.face(behind, WHITE, 1.0)
    canvas.photo(np.full((9, 16, 3), 255, dtype=np.uint8), behind)
    assert not canvas.image().any()


def test_a_homography_takes_corners_to_corners(rng: np.random.Generator):
    sources = np.array([(0, 0), (4, 0), (4, 3), (0, 3)]) + rng.uniform(-0.5, 0.5, size=(4, 2))
    targets = np.array([(10, 10), (90, 20), (80, 70), (5, 60.0)])
    mapped = np.concatenate([sources, np.ones((4, 1))], axis=1) @ homography(sources, targets).T
    np.testing.assert_allclose(mapped[:, :2] / mapped[:, 2:], targets, atol=1e-9)


@pytest.mark.slow
@given(
    st.lists(st.tuples(st.floats(0.05, 1.5), st.floats(-3, 3), st.floats(0.2, 0.9)), min_size=1, max_size=5)
)
def test_spherical_coordinates_lead_back(places: list[tuple[float, float, float]]):
    workspace = Workspace()
    points = from_spherical(np.array(places), workspace)
    np.testing.assert_allclose(from_spherical(spherical(points, workspace), workspace), points, atol=1e-9)


def test_the_way_goes_through_the_cameras_and_stays_on_their_sphere(
    cameras: list[Camera], workspace: Workspace
):
    centres = np.array([camera.centre for camera in cameras])
    way = way_between(centres, workspace)
    for centre in centres:
        assert np.linalg.norm(way - centre, axis=1).min() < 1e-9
    np.testing.assert_allclose(spherical(way, workspace)[:, 2], 0.5, atol=1e-9)
    assert len(way_between(centres[:1], workspace)) == 1


def test_the_eye_sees_all_points_and_no_more_than_it_must(workspace: Workspace, rng: np.random.Generator):
    points = rng.uniform(-0.2, 0.6, size=(30, 3))
    eye = eye_that_sees(points, workspace, 1.1, 0.4, (300, 200))
    pixels, depth = eye.project(points)
    assert (depth > 0).all()
    assert (pixels > 0).all()
    assert (pixels < (299, 199)).all()
    spread = np.ptp(pixels, axis=0) / (300, 200)
    assert spread.max() == pytest.approx(0.92, abs=0.01)
