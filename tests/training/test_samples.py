"""Training samples: photos, cameras, labels and grids of one scene belong together."""

from __future__ import annotations

import numpy as np
import torch
from scipy import ndimage

from neugrasp.change_mask import OBJECT, TABLE, change_labels
from neugrasp.data.records import Record
from neugrasp.training.prepared import PreparedView, crop_views
from neugrasp.training.samples import Sample, drop_views, sample_of


def sample(record: Record, size: int = 64, seed: int | None = None) -> Sample:
    """The record as a step sees it, augmented where a seed is given."""
    groups = tuple(
        tuple(PreparedView(view, change_labels(view.image, view.background)) for view in group)
        for group in crop_views(record.grasp_scene(), size)
    )
    return sample_of(record.grasp_scene(), groups, None if seed is None else np.random.default_rng(seed))


def test_an_augmented_sample_is_the_same_each_time_it_is_made(make_record):
    first, second = (sample(make_record(), seed=5) for _ in range(2))
    assert torch.equal(first.inputs.views.images, second.inputs.views.images)
    assert torch.equal(first.truth.tsdf, second.truth.tsdf)
    assert torch.equal(first.truth.labels.index, second.truth.labels.index)


def test_labels_lie_on_their_object(make_record):
    """Every success of the ball lies where the distance is small, whatever the symmetry."""
    record = make_record(x=0.1, y=0.2)
    for seed in range(6):
        truth = sample(record, seed=seed).truth
        x, y, z = truth.labels.index[truth.labels.success].T
        assert (truth.tsdf[x, y, z].abs() < 0.6).all()


def test_another_network_size_keeps_the_geometry(make_record):
    large = sample(make_record(size=128))
    small = sample(make_record(size=64))
    torch.testing.assert_close(large.inputs.views.cameras.intrinsics, small.inputs.views.cameras.intrinsics)
    coarse, fine = small.inputs.views.images, large.inputs.views.images
    shifted = [(fine.roll(step, 3) - coarse).abs().mean() for step in (-1, 1)]
    assert (fine - coarse).abs().mean() < 0.7 * min(shifted)


def test_the_ball_is_found_as_change_and_the_table_as_table(make_record):
    record = make_record(size=128)
    changes = sample(record, 128).inputs.changes.numpy()
    for view in range(4):
        ball = record.depths[view] < make_record(size=128, x=5.0).depths[view] - 1e-4
        labels = changes[view]
        assert (labels[ball] == OBJECT).mean() > 0.5
        inside = ndimage.binary_erosion(ball)  # the outline itself is known to a pixel
        assert not (labels[inside] == TABLE).any()
        assert not (labels[~ball] == OBJECT).any()
        assert (labels[~ball] == TABLE).mean() > 0.8


def test_dropping_views_keeps_photos_and_cameras_together(make_record):
    inputs = sample(make_record()).inputs
    kept = drop_views(inputs, [3, 1])
    assert torch.equal(kept.views.images[0], inputs.views.images[3])
    assert torch.equal(kept.views.cameras.centres[1], inputs.views.cameras.centres[1])
