"""A detection stands alone: arrays, plain data and files say the same."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neugrasp.detection.contract import Detection
from neugrasp.detection.files import read_grasps
from neugrasp.detection.registry import DetectorSpec, detector_spec
from neugrasp.errors import InputError
from neugrasp.geometry.pose import from_quaternion, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper, bundled
from neugrasp.observation import Views

PLACE = rigid(from_quaternion((0, 0, 0.6, 0.8))[:3, :3], (1.0, -2.0, 0.4))
WORKSPACE = Workspace(world_from_workspace=PLACE)
number = st.floats(-10, 10)
grasps = st.builds(
    lambda quaternion, place, width, score: Grasp(from_quaternion(quaternion, place), width, score),
    st.tuples(number, number, number, number).filter(lambda q: np.linalg.norm(q) > 0.1),
    st.tuples(number, number, number),
    st.floats(0.001, 0.1),
    st.floats(0, 1),
)


def found(*each: Grasp, tsdf: np.ndarray | None = None) -> Detection:
    seconds = {"images": 0.25}
    gripper = Gripper.load("robotiq_2f85")
    return Detection(
        Grasps.of(each), WORKSPACE, gripper, tsdf, {"too_narrow": 3}, 0.4, 0.9, seconds, "a scene"
    )


def ball() -> np.ndarray:
    distance = np.linalg.norm(WORKSPACE.voxel_centres() - WORKSPACE.centre - (0, 0, 0.05), axis=-1) - 0.03
    return (distance / WORKSPACE.truncation).clip(-1, 1).astype(np.float32)


@pytest.mark.slow
@given(st.lists(grasps, max_size=5))
def test_arrays_iterate_as_grasps(each: list[Grasp]):
    arrays = Grasps.of(each)
    assert len(arrays) == len(list(arrays)) == len(each)
    for one, other in zip(arrays, each, strict=True):
        assert np.array_equal(one.pose, other.pose)
        assert (one.width, one.score) == (other.width, other.score)
    kept = arrays[arrays.scores > 0.5]
    assert [grasp.score for grasp in kept] == [grasp.score for grasp in each if grasp.score > 0.5]
    assert np.array_equal(arrays[1:].positions, np.array([g.position for g in each[1:]]).reshape(-1, 3))


def test_arrays_that_do_not_fit_are_refused():
    eye = np.eye(4)[None]
    with pytest.raises(ValueError, match="shapes"):
        Grasps(eye, np.ones(2), np.ones(1))
    with pytest.raises(ValueError, match="NaN"):
        Grasps(eye * np.nan, np.ones(1), np.ones(1))
    with pytest.raises(ValueError, match="the workspace has"):
        found(tsdf=np.zeros((8, 8, 8), np.float32))


@pytest.mark.slow
@settings(deadline=None)
@given(st.lists(grasps, max_size=3), st.booleans())
def test_plain_data_restores_it(each: list[Grasp], with_surface: bool):
    before = found(*sorted(each, key=lambda grasp: -grasp.score), tsdf=ball())
    after = Detection.from_dict(json.loads(json.dumps(before.to_dict(with_surface))))
    assert np.allclose(after.grasps.poses, before.grasps.poses, rtol=0, atol=1e-12)
    for field in ("widths", "scores"):
        assert np.array_equal(getattr(after.grasps, field), getattr(before.grasps, field))
    for field in ("rejected", "best_rejected", "threshold", "timing_s", "source"):
        assert getattr(after, field) == getattr(before, field)
    assert after.workspace.cube == WORKSPACE.cube
    assert np.array_equal(after.workspace.world_from_workspace, PLACE)
    assert (after.tsdf is not None) == with_surface
    if with_surface:
        assert np.array_equal(after.grid(), before.grid())


@pytest.mark.parametrize("name", bundled())
def test_a_gripper_is_restored_to_the_last_corner(name: str):
    gripper = Gripper.load(name)
    again = Gripper.from_dict(json.loads(json.dumps(gripper.to_dict())))
    assert again.to_dict() == gripper.to_dict()
    for part in ("palm", "finger"):
        for one, other in zip(getattr(again, part).hulls, getattr(gripper, part).hulls, strict=True):
            assert np.array_equal(one, other)
    assert (again.max_opening, again.pads, again.finger_mount) == (
        gripper.max_opening, gripper.pads, gripper.finger_mount,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"workspace": {"size": "wide"}}, "workspace.size is 'wide'"),
        ({"workspace": {"depth": 1}}, "workspace.depth is unknown"),
        ({"gripper_file": {}}, "gripper_file.format is None"),
        ({"tsdf": "?"}, "tsdf cannot be unpacked"),
        ({"tsdf": "eJxjAAAAAQAB"}, "tsdf holds 1 bytes"),
        ({"threshold": 2}, "threshold is 2"),
        ({"rejected": {"too_low": -1}}, "rejected.too_low is -1"),
        ({"timing_s": {"images": "long"}}, "timing_s.images is 'long'"),
    ],
)
def test_damaged_data_is_refused_by_field(change: dict[str, object], words: str):
    with pytest.raises(InputError, match=f"an answer: {words}"):
        Detection.from_dict(found(tsdf=ball()).to_dict(True) | change, "an answer")


@pytest.mark.slow
def test_saved_files_are_read_by_the_others(tmp_path: Path, small_views: Views):
    grasp = Grasp(from_quaternion((1, 0, 0, 0), (1.0, -2.0, 0.5)), 0.04, 0.9)
    found(grasp, tsdf=ball()).save(tmp_path / "out", small_views)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == [
        "grasps.json", "overlay.png", "surface.ply", "tsdf.npz",
    ]  # fmt: skip
    assert np.allclose(read_grasps(tmp_path / "out" / "grasps.json")[0].pose, grasp.pose, atol=1e-9)
    # A detector without a surface leaves none, not even that of an earlier one.
    found(grasp).save(tmp_path / "out")
    assert [file.name for file in (tmp_path / "out").iterdir()] == ["grasps.json"]
    with pytest.raises(InputError, match="a scene: this detector finds grasps without a surface"):
        found(grasp).surface()


def test_the_surface_lies_in_the_world():
    vertices = found(tsdf=ball()).surface().vertices
    middle = WORKSPACE.to_world(WORKSPACE.centre + np.array([0, 0, 0.05]))
    assert np.allclose(np.linalg.norm(vertices - middle, axis=1), 0.03, atol=0.001)


def test_a_spec_observes_what_cameras_see():
    with pytest.raises(ValueError, match="choose of image, background, depth"):
        DetectorSpec(frozenset({"smell"}), lambda _options: None)  # type: ignore[arg-type,return-value]
    with pytest.raises(InputError, match="cannot be imported"):
        detector_spec("no_such_module:SPEC")
    with pytest.raises(InputError, match="is a function, not a DetectorSpec"):
        detector_spec("json:loads")
