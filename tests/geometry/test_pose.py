"""Rotations and rigid transforms."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from neugrasp.geometry.pose import (
    Array,
    apply,
    from_quaternion,
    inverse,
    is_rigid,
    look_at,
    rigid,
    rotation_about,
    to_quaternion,
)

coordinates = st.floats(-2, 2)
points = st.tuples(coordinates, coordinates, coordinates)


@st.composite
def poses(draw: st.DrawFn) -> Array:
    quaternion = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 4)))
    assume(np.linalg.norm(quaternion) > 0.1)
    return from_quaternion(quaternion / np.linalg.norm(quaternion), draw(points))


@pytest.mark.slow
@given(poses(), poses(), points)
def test_transforms_compose_as_their_names_say(a_from_b: Array, b_from_c: Array, point_c: tuple[float, ...]):
    np.testing.assert_allclose(
        apply(a_from_b @ b_from_c, point_c), apply(a_from_b, apply(b_from_c, point_c)), atol=1e-9
    )


@pytest.mark.slow
@given(poses(), points)
def test_an_inverse_undoes_its_transform(a_from_b: Array, point: tuple[float, ...]):
    np.testing.assert_allclose(apply(inverse(a_from_b), apply(a_from_b, point)), point, atol=1e-9)
    np.testing.assert_allclose(inverse(a_from_b), np.linalg.inv(a_from_b), atol=1e-9)


@pytest.mark.slow
@given(poses(), points, points)
def test_rigid_transforms_keep_distances(pose: Array, p: tuple[float, ...], q: tuple[float, ...]):
    assert is_rigid(pose)
    moved = np.linalg.norm(apply(pose, p) - apply(pose, q))
    assert moved == pytest.approx(np.linalg.norm(np.subtract(p, q)), abs=1e-9)


@pytest.mark.slow
@given(poses())
def test_a_quaternion_gives_its_rotation_back(pose: Array):
    quaternion = to_quaternion(pose)
    assert quaternion[3] >= 0
    np.testing.assert_allclose(from_quaternion(quaternion, pose[:3, 3]), pose, atol=1e-9)


def test_quaternions_are_xyzw():
    quarter_turn_about_z = from_quaternion([0, 0, np.sqrt(0.5), np.sqrt(0.5)])
    np.testing.assert_allclose(apply(quarter_turn_about_z, [1, 0, 0]), [0, 1, 0], atol=1e-12)


@pytest.mark.slow
@given(points, st.floats(-3, 3), st.floats(-3, 3))
def test_turns_about_one_axis_add_up(axis: tuple[float, ...], first: float, second: float):
    assume(np.linalg.norm(axis) > 0.1)
    both = rotation_about(axis, first) @ rotation_about(axis, second)
    np.testing.assert_allclose(both, rotation_about(axis, first + second), atol=1e-9)


@pytest.mark.slow
@given(points, points)
def test_a_camera_looks_at_its_target_with_the_sky_above(eye: tuple[float, ...], target: tuple[float, ...]):
    assume(np.linalg.norm(np.subtract(target, eye)) > 0.1)
    world_from_camera = look_at(eye, target)
    assert is_rigid(world_from_camera)
    seen = apply(inverse(world_from_camera), target)
    np.testing.assert_allclose(seen, [0, 0, np.linalg.norm(np.subtract(target, eye))], atol=1e-9)
    # The image's x axis is level and its y axis never points upwards.
    upright = np.linalg.norm(np.cross(world_from_camera[:3, 2], [0, 0, 1])) > 1e-5
    if upright:
        assert abs(world_from_camera[2, 0]) < 1e-6
        assert world_from_camera[2, 1] < 1e-6


def test_a_camera_can_look_straight_down():
    assert is_rigid(look_at((0, 0, 1), (0, 0, 0)))


@pytest.mark.parametrize(
    "wrong",
    [
        rigid(np.diag([1, 1, -1])),
        rigid(2 * np.eye(3)),
        np.eye(3),
        np.vstack([np.eye(4)[:3], [1, 0, 0, 1]]),
        np.full((4, 4), np.nan),
    ],
    ids=["mirrored", "scaled", "3x3", "last row", "nan"],
)
def test_what_is_not_rigid_is_called_so(wrong: Array):
    assert not is_rigid(wrong)
