"""The files of a prediction are what the contract says, whole or not there."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.files import read_grasps, write_grasps, write_surface, write_tsdf
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.geometry.pose import from_quaternion
from neugrasp.geometry.surface import surface_of
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp

GRASP = Grasp(from_quaternion([1, 0, 0, 0], (0.1, 0.2, 0.3)), width=0.05, score=0.97)


def test_grasps_json_is_the_contract(tmp_path: Path):
    file = tmp_path / "grasps.json"
    worse = Grasp(GRASP.pose, 0.04, 0.91)
    write_grasps(file, [worse, GRASP], {"rejected": {"too_narrow": 3}, "timing_s": {"images": 0.25}})
    way = {"pregrasp_position": [0.1, 0.2, 0.35], "retreat_position": [0.1, 0.2, 0.4]}
    assert json.loads(file.read_text()) == {
        "format": "neugrasp-grasps",
        "version": 1,
        "frame": "world",
        "up": [0, 0, 1],
        "grasps": [
            {
                "position": [0.1, 0.2, 0.3],
                "quaternion_xyzw": [1, 0, 0, 0],
                "width": 0.05,
                "score": 0.97,
                **way,
            },
            {
                "position": [0.1, 0.2, 0.3],
                "quaternion_xyzw": [1, 0, 0, 0],
                "width": 0.04,
                "score": 0.91,
                **way,
            },
        ],
        "rejected": {"too_narrow": 3},
        "timing_s": {"images": 0.25},
    }


finite = st.floats(-10, 10)


@settings(max_examples=40, deadline=None)
@given(
    st.lists(
        st.tuples(
            st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: np.linalg.norm(q) > 0.1),
            st.tuples(finite, finite, finite),
            st.floats(1e-4, 0.2),
            st.floats(0, 1),
        ),
        max_size=5,
    )
)
def test_any_grasps_survive_the_disk(tmp_path_factory: pytest.TempPathFactory, raw: list[tuple]):
    grasps = [Grasp(from_quaternion(q, p), width, score) for q, p, width, score in raw]
    file = tmp_path_factory.getbasetemp() / "grasps.json"
    write_grasps(file, grasps)
    read = read_grasps(file)
    assert len(read) == len(grasps)
    for one, other in zip(read, sorted(grasps, key=lambda grasp: -grasp.score), strict=True):
        np.testing.assert_allclose(one.pose, other.pose, atol=1e-9)
        assert (one.width, one.score) == (other.width, other.score)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"format": "neugrasp-grasps", "version": 9}'])
def test_damaged_grasps_name_their_file(tmp_path: Path, text: str):
    file = tmp_path / "grasps.json"
    with pytest.raises(InputError, match=r"grasps\.json: missing"):
        read_grasps(file)
    file.write_text(text)
    with pytest.raises(
        InputError, match=r"grasps\.json: (not valid JSON|the file is not|format is None|version is 9)"
    ):
        read_grasps(file)


def test_a_ply_file_holds_the_surface(
    tmp_path: Path, workspace: Workspace, ball_on_table: Callable[..., np.ndarray]
):
    """Read by another library, where it is installed."""
    trimesh = pytest.importorskip("trimesh")
    surface = surface_of(ball_on_table((0.15, 0.15, 0.12), 0.05, with_table=False), workspace)
    write_surface(tmp_path / "surface.ply", surface)
    mesh = trimesh.load(tmp_path / "surface.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, surface.vertices, atol=1e-6)
    np.testing.assert_array_equal(mesh.faces, surface.faces)
    assert mesh.is_watertight
    assert mesh.volume > 0


def test_the_grid_comes_with_what_places_it(tmp_path: Path):
    workspace = Workspace(world_from_workspace=from_quaternion([0, 0, 0, 1], (1, 2, 3)))
    grid = np.linspace(-1, 1, 64000, dtype=np.float32).reshape(40, 40, 40)
    write_tsdf(tmp_path / "tsdf.npz", grid, workspace)
    with np.load(tmp_path / "tsdf.npz") as arrays:
        np.testing.assert_array_equal(arrays["tsdf"], grid)
        assert (float(arrays["size"]), float(arrays["truncation"])) == (0.30, 0.03)
        np.testing.assert_array_equal(arrays["world_from_workspace"], workspace.world_from_workspace)


def test_a_folder_is_written_whole(tmp_path: Path):
    out = tmp_path / "deep" / "out"
    with whole_or_nothing(out) as part:
        (part / "a.txt").write_text("a")
        assert not (out / "a.txt").exists()
    assert [file.name for file in out.iterdir()] == ["a.txt"]


def test_after_a_failure_nothing_new_is_there_and_nothing_old_is_gone(tmp_path: Path):
    fresh, used = tmp_path / "fresh", tmp_path / "used"
    used.mkdir()
    (used / "a.txt").write_text("old")

    def write_until_the_disk_is_full(out: Path) -> None:
        with whole_or_nothing(out) as part:
            (part / "a.txt").write_text("new")
            raise OSError(28, "No space left on device")

    for out in (fresh, used):
        with pytest.raises(NeuGraspError, match="No space"):
            write_until_the_disk_is_full(out)
    assert not fresh.exists()
    assert [(file.name, file.read_text()) for file in used.iterdir()] == [("a.txt", "old")]


def test_only_files_of_the_same_name_are_replaced(tmp_path: Path):
    (tmp_path / "a.txt").write_text("old")
    (tmp_path / "mine.txt").write_text("mine")
    with whole_or_nothing(tmp_path) as part:
        (part / "a.txt").write_text("new")
    assert {file.name: file.read_text() for file in tmp_path.iterdir()} == {
        "a.txt": "new",
        "mine.txt": "mine",
    }
