"""t-SNE keeps neighbours together, and principal components are what they are called."""

from __future__ import annotations

import numpy as np
import pytest

from neugrasp.figures.embedding import (
    principal_components,
    share_of_like_neighbours,
    tsne,
)


@pytest.fixture
def groups(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Three clouds in 16 dimensions, as wide as they are far apart in any single one; which is which."""
    kinds = np.repeat(np.arange(3), 50)
    centres = 4 * rng.normal(size=(3, 16))
    return centres[kinds] + rng.normal(size=(150, 16)), kinds


@pytest.mark.slow
def test_groups_stay_groups(groups: tuple[np.ndarray, np.ndarray]):
    vectors, kinds = groups
    points = tsne(vectors, perplexity=15)
    assert share_of_like_neighbours(points, kinds, 10) > 0.99
    middles = np.array([points[kinds == kind].mean(axis=0) for kind in range(3)])
    widths = [np.linalg.norm(points[kinds == kind] - middles[kind], axis=1).mean() for kind in range(3)]
    apart = min(np.linalg.norm(middles[a] - middles[b]) for a, b in ((0, 1), (0, 2), (1, 2)))
    assert apart > 2 * max(widths)


@pytest.mark.slow
def test_the_same_vectors_give_the_same_points_and_nothing_is_lost(groups: tuple[np.ndarray, np.ndarray]):
    vectors, _ = groups
    once, again = (tsne(vectors, perplexity=15) for _ in range(2))
    np.testing.assert_array_equal(once, again)
    assert once.shape == (150, 2)
    assert np.isfinite(once).all()


def test_components_are_the_coordinates_of_a_turned_box(rng: np.random.Generator):
    box = rng.uniform(-1, 1, size=(500, 3)) * (9, 3, 1)
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    found = principal_components(box @ turn.T, 3)
    for k in range(3):
        assert abs(np.corrcoef(found[:, k], box[:, k])[0, 1]) > 0.99
    np.testing.assert_allclose(principal_components(box @ turn.T + 5, 3), found, atol=1e-9)


def test_neighbours_of_rare_kinds_count_as_much():
    vectors = np.concatenate([np.zeros((90, 1)), np.ones((10, 1))]) + np.linspace(0, 0.1, 100)[:, None]
    kinds = np.repeat([0, 1], [90, 10])
    assert share_of_like_neighbours(vectors, kinds, 5) == 1
    # A vector of the wrong kind among its like has no like neighbours, and spoils ten others' at most.
    mixed = np.tile([0, 1], 50)
    assert share_of_like_neighbours(np.arange(100.0)[:, None], mixed, 2) < 0.05
