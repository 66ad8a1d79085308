"""Vectors of many dimensions as points or colours: t-SNE and principal components."""

from __future__ import annotations

import numpy as np
from scipy.spatial.distance import cdist

from neugrasp.errors import require
from neugrasp.geometry.pose import Array


def principal_components(vectors: Array, count: int) -> Array:
    """The coordinates (n, count) along the directions in which vectors (n, d) vary most."""
    centred = vectors - vectors.mean(axis=0)
    _, _, directions = np.linalg.svd(centred, full_matrices=False)
    # A direction is known up to its sign: its largest entry is made positive.
    largest = np.take_along_axis(directions, np.abs(directions).argmax(axis=1)[:, None], axis=1)
    coordinates: Array = centred @ (directions * np.sign(largest))[:count].T
    return coordinates


def tsne(vectors: Array, perplexity: float = 30.0) -> Array:
    """Points (n, 2) that are neighbours where vectors (n, d) are (van der Maaten and Hinton, 2008).

    It starts from the principal components, so the same vectors give the same points. Raises `MissingExtra`
    without scikit-learn, `ValueError` where there are too few vectors for `perplexity`.
    """
    manifold = require("sklearn.manifold", extra="figures")
    found = manifold.TSNE(perplexity=perplexity, init="pca", random_state=0).fit_transform(vectors)
    return np.asarray(found, dtype=np.float64)


def share_of_like_neighbours(vectors: Array, kinds: np.ndarray, count: int = 10) -> float:
    """How many of the `count` nearest neighbours of a vector (n, d) are of its kind (n,), 0 to 1.

    Every kind counts the same, however many vectors it has.
    """
    distances = cdist(vectors, vectors)
    np.fill_diagonal(distances, np.inf)
    nearest = np.argsort(distances, axis=1)[:, :count]
    same = (kinds[nearest] == kinds[:, None]).mean(axis=1)
    return float(np.mean([same[kinds == kind].mean() for kind in np.unique(kinds)]))
