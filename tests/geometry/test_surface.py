"""A known ball comes out of its distance grid with its place, size and orientation."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neugrasp.geometry.pose import rigid
from neugrasp.geometry.surface import surface_of
from neugrasp.geometry.workspace import Workspace

WORKSPACE = Workspace()


@settings(max_examples=20, deadline=None)
@given(st.tuples(*[st.floats(0.1, 0.2)] * 3), st.floats(0.02, 0.06))
def test_a_ball_has_its_centre_and_radius(centre: tuple[float, float, float], radius: float):
    distance = np.linalg.norm(WORKSPACE.voxel_centres() - centre, axis=-1) - radius
    surface = surface_of((distance / WORKSPACE.truncation).clip(-1, 1), WORKSPACE)
    radii = np.linalg.norm(surface.vertices - centre, axis=-1)
    assert np.abs(radii - radius).max() < 0.001
    middle = (surface.vertices.min(axis=0) + surface.vertices.max(axis=0)) / 2
    np.testing.assert_allclose(middle, centre, atol=0.001)
    # Faces seen from outside run counter-clockwise, so the enclosed volume comes out positive.
    a, b, c = (surface.vertices[surface.faces[:, k]] - centre for k in range(3))
    volume = (np.cross(a, b) * c).sum() / 6
    assert volume == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.12)


def test_a_grid_of_one_sign_has_no_surface(workspace: Workspace):
    for value in (-1.0, 1.0):
        surface = surface_of(np.full((40, 40, 40), value), workspace)
        assert surface.vertices.shape == (0, 3)
        assert surface.faces.shape == (0, 3)


def test_nan_is_refused(workspace: Workspace):
    with pytest.raises(ValueError, match="NaN"):
        surface_of(np.full((40, 40, 40), np.nan), workspace)


def test_a_surface_moves_with_its_frame(workspace: Workspace, ball_on_table: Callable[..., np.ndarray]):
    surface = surface_of(ball_on_table((0.15, 0.15, 0.1), 0.04), workspace)
    moved = surface.moved(rigid(translation=(1, 0, 0)))
    np.testing.assert_allclose(
        moved.vertices - surface.vertices, np.broadcast_to([1, 0, 0], moved.vertices.shape)
    )
