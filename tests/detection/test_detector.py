"""One detector at several cells, in several threads, and at cubes that it does not know."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import torch

from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.gripper import Gripper
from neugrasp.model.network import NeuGrasp
from neugrasp.observation import Views
from neugrasp.training.recipes import tiny


@pytest.fixture
def detector() -> NeuGraspDetector:
    torch.manual_seed(0)
    return NeuGraspDetector(NeuGrasp(tiny().model), Gripper.load("panda"))


def with_other_backgrounds(views: Views) -> Views:
    """The same photos at a cell whose empty table looks otherwise."""
    return replace(
        views, frames=tuple(replace(view, background=255 - view.background) for view in views.frames)
    )


def fresh(detector: NeuGraspDetector, views: Views) -> np.ndarray:
    """The surface that a detector without a memory finds."""
    return NeuGraspDetector(detector.model, detector.gripper).detect(views).tsdf


@pytest.mark.slow
def test_a_second_cell_is_not_taken_for_the_first(detector: NeuGraspDetector, small_views: Views):
    other = with_other_backgrounds(small_views)
    expected = {id(views): fresh(detector, views) for views in (small_views, other)}
    assert not np.array_equal(*expected.values())
    for views in (small_views, other, other, small_views):
        np.testing.assert_array_equal(detector.detect(views).tsdf, expected[id(views)])


@pytest.mark.slow
def test_backgrounds_seen_before_are_not_encoded_again(
    detector: NeuGraspDetector, small_views: Views, monkeypatch: pytest.MonkeyPatch
):
    calls = []
    encode = detector.model.encode
    monkeypatch.setattr(detector.model, "encode", lambda images: calls.append(len(images)) or encode(images))
    detector.detect(small_views)
    first = len(calls)
    detector.detect(small_views)
    assert (first, len(calls)) == (2, 3)


@pytest.mark.slow
def test_two_threads_at_two_cells(detector: NeuGraspDetector, small_views: Views):
    cells = [small_views, with_other_backgrounds(small_views)]
    expected = [fresh(detector, views) for views in cells]
    threads = torch.get_num_threads()
    with ThreadPoolExecutor(2) as pool:
        found = list(pool.map(lambda index: detector.detect(cells[index % 2]).tsdf, range(12)))
    for index, tsdf in enumerate(found):
        np.testing.assert_allclose(tsdf, expected[index % 2], atol=1e-5)
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(torch.get_num_threads).result() == threads


@pytest.mark.slow
def test_the_cache_is_exchanged_as_a_whole(detector: NeuGraspDetector, small_views: Views, monkeypatch):
    """Another thread comes to another cell while this one encodes its own backgrounds."""
    other = with_other_backgrounds(small_views)
    expected = fresh(detector, small_views)
    encode = detector.model.encode

    def interrupted(images: torch.Tensor) -> torch.Tensor:
        monkeypatch.setattr(detector.model, "encode", encode)
        maps = encode(images)
        detector.detect(other)
        return maps

    monkeypatch.setattr(detector.model, "encode", interrupted)
    np.testing.assert_array_equal(detector.detect(small_views).tsdf, expected)
    np.testing.assert_array_equal(detector.detect(small_views).tsdf, expected)


@pytest.mark.parametrize(
    "change", [{"size": 0.45}, {"resolution": 48}, {"table_height": 0.04}, {"truncation": 0.02}]
)
def test_another_cube_is_refused(detector: NeuGraspDetector, small_views: Views, change: dict[str, float]):
    other = replace(small_views, workspace=replace(small_views.workspace, **change))
    with pytest.raises(InputError, match=r"the scene's workspace is .* these weights were trained for"):
        detector.detect(other)


@pytest.mark.slow
def test_a_cube_elsewhere_in_the_world_is_the_same_cube(detector: NeuGraspDetector, small_views: Views):
    place = np.eye(4)
    place[:3, 3] = 1.0, -2.0, 0.5
    workspace = replace(small_views.workspace, world_from_workspace=place)
    views = tuple(replace(view, camera=view.camera.moved(place)) for view in small_views.frames)
    np.testing.assert_allclose(
        detector.detect(Views(views, workspace)).tsdf, detector.detect(small_views).tsdf, atol=1e-4
    )
