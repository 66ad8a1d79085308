"""The named viewpoints are where the sources say."""

from __future__ import annotations

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.geometry.pose import Array
from neugrasp.geometry.view_sets import VIEW_SETS, hemisphere, view_set
from neugrasp.geometry.workspace import Workspace


def about_table(workspace: Workspace, centre: Array) -> tuple[float, float, float]:
    """Radius in metres, polar angle from the vertical and azimuth in degrees."""
    offset = centre - workspace.centre
    radius = float(np.linalg.norm(offset))
    azimuth = np.rad2deg(np.arctan2(offset[1], offset[0])) % 360
    return radius, float(np.rad2deg(np.arccos(offset[2] / radius))), float(azimuth)


def test_the_released_arc_is_that_of_the_released_code(workspace: Workspace, rng: np.random.Generator):
    expected = [
        (-0.1768, -0.3062, 0.3536),
        (-0.0498, -0.2824, 0.4096),
        (0.0367, -0.2081, 0.4532),
        (0.0647, -0.1121, 0.4830),
    ]
    centres = [camera.centre - workspace.centre for camera in view_set("released", workspace, rng)]
    np.testing.assert_allclose(centres, expected, atol=1e-4)


@pytest.mark.parametrize("seed", range(20))
def test_the_papers_views_stay_in_the_papers_ranges(workspace: Workspace, seed: int):
    places = [
        about_table(workspace, camera.centre)
        for camera in view_set("paper", workspace, np.random.default_rng(seed))
    ]
    assert len({round(radius, 6) for radius, _, _ in places}) == 1
    for radius, polar, _ in places:
        assert 0.4 <= radius <= 0.5
        assert 15 - 1e-6 <= polar <= 22.5 + 1e-6
    assert (places[3][2] - places[0][2]) % 360 == pytest.approx(60)


def test_vgns_views_are_those_of_its_own_simulator(workspace: Workspace, rng: np.random.Generator):
    floor = np.array([0.15, 0.15, 0.0])
    for j, camera in enumerate(view_set("hemisphere6", workspace, rng)):
        offset = camera.centre - floor
        assert np.linalg.norm(offset) == pytest.approx(0.6)
        assert offset[2] == pytest.approx(0.6 * np.cos(np.pi / 6))
        assert np.rad2deg(np.arctan2(offset[1], offset[0])) % 360 == pytest.approx(60 * j, abs=1e-6)
        np.testing.assert_allclose(camera.project(floor)[0], (320, 240), atol=1e-6)


@pytest.mark.parametrize("name", sorted(set(VIEW_SETS) - {"hemisphere6"}))
def test_every_view_shows_the_middle_of_the_table_in_its_middle(
    workspace: Workspace, rng: np.random.Generator, name: str
):
    for camera in view_set(name, workspace, rng):
        pixel, depth = camera.project(workspace.centre)
        np.testing.assert_allclose(pixel, (319.75, 179.75), atol=1e-6)
        assert 0.35 < depth < 0.65


def test_target_views_come_from_the_whole_hemisphere(workspace: Workspace, rng: np.random.Generator):
    places = [about_table(workspace, camera.centre) for camera in hemisphere(workspace, rng, num=400)]
    polar, azimuth = np.array(places)[:, 1], np.array(places)[:, 2]
    assert polar.min() < 15
    assert 70 < polar.max() <= 75
    # Uniform over the area: as many above 51 degrees as below, since cos(51) is the middle of the range.
    assert (
        0.4
        < np.mean(polar < np.rad2deg(np.arccos((np.cos(np.deg2rad(75)) + np.cos(np.deg2rad(5))) / 2)))
        < 0.6
    )
    assert np.histogram(azimuth, bins=8, range=(0, 360))[0].min() > 25


def test_the_same_generator_state_gives_the_same_views(workspace: Workspace):
    first, second = (view_set("training", workspace, np.random.default_rng(7)) for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one.world_from_camera, other.world_from_camera)


def test_an_unknown_view_set_names_the_known_ones(workspace: Workspace, rng: np.random.Generator):
    with pytest.raises(InputError, match="paper, released"):
        view_set("best", workspace, rng)
