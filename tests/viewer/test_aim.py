"""Pointing at an object chooses its grasps, in any world."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from neugrasp.geometry.pose import apply
from neugrasp.viewer.aim import object_on_line
from neugrasp.viewer.drawing import grasps_of, nodes_of
from neugrasp.viewer.primitives import LinesNode
from neugrasp.viewer.scene_data import SceneData
from neugrasp.viewer.settings import Settings

from .conftest import BALL, RADIUS, WORLD_FROM_WORKSPACE

ABOVE, DOWN = np.array((0.0, 0.0, 1.0)), np.array((0.0, 0.0, -1.0))


@pytest.mark.slow
@pytest.mark.parametrize("eye", [(0.15, 0.15, 0.6), (0.5, 0.15, 0.08), (-0.2, -0.3, 0.5), (0.15, 0.15, 5.0)])
def test_a_line_of_sight_meets_what_it_is_aimed_at(data: SceneData, eye: tuple[float, ...]):
    grid = data.moments[0].tsdf
    origin = np.array(eye)
    found = object_on_line(grid, data.workspace, origin, 3.0 * (BALL - origin))
    assert found is not None
    assert np.linalg.norm(found.voxels - BALL, axis=1).max() < RADIUS + data.workspace.voxel_size
    beside = np.array((0.05, 0.25, 0.05)) - origin
    if eye[2] > 0.3:
        assert object_on_line(grid, data.workspace, origin, beside) is None
    assert object_on_line(grid, data.workspace, origin, origin - BALL) is None


def test_nothing_is_met_where_nothing_stands(data: SceneData):
    free = np.ones((40, 40, 40), np.float32)
    assert object_on_line(free, data.workspace, BALL + ABOVE, DOWN) is None
    grid = data.moments[0].tsdf
    assert object_on_line(grid, data.workspace, BALL + ABOVE, np.zeros(3)) is None


def test_the_region_of_an_object_keeps_its_grasps_and_is_drawn_around_it(data: SceneData):
    found = object_on_line(data.moments[0].tsdf, data.workspace, BALL + ABOVE, DOWN)
    region = found.region(data.workspace)
    settings = Settings(region=region).suited_to(data)
    assert len(grasps_of(data, settings)) == len(grasps_of(data, replace(settings, region=None))) == 3
    away = tuple(edge + 1 for edge in region)
    assert grasps_of(data, replace(settings, region=away)) == ()
    (box,) = [node for node in nodes_of(data, settings) if node.name == "region"]
    assert isinstance(box, LinesNode)
    corners = apply(WORLD_FROM_WORKSPACE, box.segments.reshape(-1, 3))
    np.testing.assert_allclose(corners.min(axis=0), region[:3], atol=1e-9)
    np.testing.assert_allclose(corners.max(axis=0), region[3:], atol=1e-9)
