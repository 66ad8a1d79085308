"""What the doctor measures is what was done to the photos."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from ray_traced import Room, photo, view_of
from scipy import ndimage

from neugrasp.doctor.capture import Capture
from neugrasp.doctor.examination import examine
from neugrasp.doctor.findings import Level
from neugrasp.doctor.light import different, drift_of
from neugrasp.doctor.light_checks import check_light
from neugrasp.doctor.registration import shift_between
from neugrasp.doctor.table import mean_correlation, table_pictures
from neugrasp.doctor.table_crop import TableCrop, grey, table_crops
from neugrasp.geometry.pose import from_quaternion, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Views

few = settings(max_examples=8, deadline=None)


@pytest.fixture(scope="session")
def crop(good: Views) -> TableCrop:
    return table_crops(good)[1]


@pytest.mark.slow
@few
@given(st.floats(-6, 6), st.floats(-6, 6), st.floats(0.5, 1.5))
def test_any_shift_is_measured_to_a_tenth_of_a_pixel_behind_objects_and_in_another_light(
    crop: TableCrop, x: float, y: float, gain: float
):
    """The second picture is the empty table moved by the opposite; the first holds objects and shadows."""
    moved = gain * ndimage.shift(grey(crop.background), (-y, -x), order=3, mode="nearest")
    shift = shift_between(grey(crop.image), moved)
    assert (shift.x, shift.y) == pytest.approx((x, y), abs=0.1)
    assert shift.agreement > 0.8


def test_pictures_of_different_things_agree_about_no_shift(crop: TableCrop, rng: np.random.Generator):
    noise = ndimage.gaussian_filter(rng.normal(size=crop.background.shape[:2]), 2)
    assert shift_between(grey(crop.image), noise).agreement < 0.3
    plain = np.full_like(noise, 0.5)
    assert shift_between(plain, plain + rng.normal(0, 0.003, plain.shape)).agreement < 0.5


@pytest.mark.slow
@few
@given(st.tuples(*[st.floats(0.6, 1.6)] * 3))
def test_exposure_and_white_balance_are_the_gains_of_the_channels(
    crop: TableCrop, gains: tuple[float, float, float]
):
    room = Room(gain=gains, seed=5)
    drift = drift_of(replace(crop, image=photo(crop.camera, room).astype(np.float32) / 255))
    stops = np.log2(gains)
    assert drift.exposure == pytest.approx(stops.mean(), abs=0.05)
    assert drift.white_balance == pytest.approx(np.ptp(stops), abs=0.05)
    assert drift.slope < 0.15


def test_what_differs_is_where_the_objects_and_their_shadows_are(crop: TableCrop):
    changed = different(crop, drift_of(crop))
    # The ball is red, the box is blue; the table is neither.
    red, blue = crop.image[..., 0] - crop.image[..., 2], crop.image[..., 2] - crop.image[..., 0]
    objects = ndimage.binary_erosion((red > 0.35) | (blue > 0.2), iterations=2)
    assert objects.sum() > 200
    assert changed[objects].mean() > 0.98
    near = ndimage.binary_dilation(objects, iterations=30)
    assert changed[~near].mean() < 0.01


def test_the_tables_agree_best_where_the_table_is(good: Views):
    cubes = [
        Workspace(world_from_workspace=rigid(translation=(0, 0, height)))
        for height in (-0.02, -0.01, 0.0, 0.01, 0.02)
    ]
    agreed = [mean_correlation(table_pictures(table_crops(replace(good, workspace=w)), w)) for w in cubes]
    assert int(np.argmax(agreed)) == 2
    assert agreed[2] > 0.95
    assert max(agreed[0], agreed[4]) < 0.6


@pytest.mark.slow
@settings(max_examples=3, deadline=None)
@given(
    st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(*[st.floats(-2, 2)] * 3),
)
def test_the_diagnosis_does_not_depend_on_the_users_world(
    good: Views, quaternion: tuple[float, ...], position: tuple[float, float, float]
):
    """Nor does a shifted background look different from there."""
    new_from_world = from_quaternion(quaternion, position)
    views = list(good.frames)
    views[0] = replace(views[0], background=np.roll(views[0].background, 2, axis=1))
    spoilt = replace(good, frames=tuple(views))
    moved = replace(
        spoilt,
        frames=tuple(replace(view, camera=view.camera.moved(new_from_world)) for view in spoilt.frames),
        workspace=replace(good.workspace, world_from_workspace=new_from_world),
    )
    here, there = examine(Capture.of(spoilt)), examine(Capture.of(moved))
    assert [finding.line() for finding in here.findings] == [finding.line() for finding in there.findings]
    assert here.level == Level.RED


@pytest.mark.slow
def test_the_order_of_the_views_changes_no_verdict(good: Views):
    turned = examine(Capture.of(replace(good, frames=good.frames[::-1])))
    assert turned.level == Level.GREEN
    straight = examine(Capture.of(good))
    assert [f.item for f in turned.findings] == [f.item for f in straight.findings]


@pytest.mark.slow
def test_long_shadows_of_a_low_lamp_are_no_change_around_the_cube_and_a_hand_there_is_one(good: Views):
    """The shadows reach out of the photo; a dark hand beside the cube stays seen, also in their light."""

    def around(hand: tuple[float, float] | None) -> Level:
        low = Room(lamp=(0.75, -0.5, 0.42), hand=hand)
        empty = replace(low, hand=None)
        frames = tuple(view_of(view.camera, low, empty) for view in good.frames)
        found = check_light(table_crops(replace(good, frames=frames)))
        return next(finding.level for finding in found if finding.item == "around the cube")

    assert around(None) == Level.GREEN
    assert around((0.42, 0.15)) != Level.GREEN
