"""The score on measured objects, on a stand-in: a cylinder whose place is known exactly."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from judge import Judge
from measured import Meshes, RealScene
from neugrasp.data.scene_folder import write_scene
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import look_at, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import View, Views
from neugrasp.simulation.meshes import Mesh, write_obj
from real import surface_errors, table_of

pytest.importorskip("pybullet")

RADIUS, HEIGHT = 0.025, 0.12
PLACE = np.array([0.13, 0.16, 0.05])
"""Of its foot in the cube."""
WORLD_FROM_WORKSPACE = rigid(translation=(0.4, -0.1, 0.2))


def cylinder() -> Mesh:
    """Upright on its frame's origin, faces inwards as some scanners write them."""
    angles = np.linspace(0, 2 * np.pi, 48, endpoint=False)
    ring = np.stack([RADIUS * np.cos(angles), RADIUS * np.sin(angles)], axis=-1)
    low, high = (np.column_stack([ring, np.full(48, z)]) for z in (0, HEIGHT))
    vertices = np.vstack([low, high, [[0, 0, 0], [0, 0, HEIGHT]]])
    i, j = np.arange(48), np.roll(np.arange(48), -1)
    sides = [np.column_stack([i, i + 48, j]), np.column_stack([j, i + 48, j + 48])]
    lids = [np.column_stack([np.full(48, 96), i, j]), np.column_stack([np.full(48, 97), j + 48, i + 48])]
    return Mesh(vertices, np.concatenate([*sides, *lids]))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("real")
    write_obj(folder / "objects/can.obj", (cylinder(),))
    grey = np.full((48, 64, 3), 128, dtype=np.uint8)
    intrinsics = np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]])
    middle = WORLD_FROM_WORKSPACE[:3, 3] + Workspace().centre
    camera = Camera(intrinsics, look_at(middle + np.array([0.2, 0, 0.4]), middle), 64, 48)
    workspace = Workspace(world_from_workspace=WORLD_FROM_WORKSPACE)
    write_scene(folder / "one", Views((View(camera, grey, grey),), workspace))
    pose = WORLD_FROM_WORKSPACE @ rigid(translation=PLACE)
    truth = {"objects": [{"id": "can", "world_from_object": pose.tolist()}]}
    (folder / "one/ground_truth.json").write_text(json.dumps(truth))
    return folder


@pytest.fixture(scope="module")
def judge(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Judge]:
    meshes = Meshes(folder / "objects", tmp_path_factory.mktemp("meshes"))
    judge = Judge(RealScene.read(folder / "one", meshes), meshes, Gripper.load("panda"))
    yield judge
    judge.world.close()


def from_above(x: float, y: float) -> Grasp:
    """The fingers 3 cm below the upper end."""
    down = np.array([[1, 0, 0], [0, -1, 0], [0, 0, -1.0]])
    return Grasp(rigid(down, (x, y, PLACE[2] + HEIGHT - 0.03)), 2 * RADIUS)


@pytest.mark.slow
def test_the_measured_object_stands_where_it_was_measured(judge: Judge):
    assert judge.lifted_mm == pytest.approx([0], abs=0.6)
    assert judge.settled_mm == pytest.approx([0], abs=1.2)
    sides = judge.truth[judge.truth[:, 2] < PLACE[2] + HEIGHT - 0.001]
    distances = np.linalg.norm(sides[:, :2] - PLACE[:2], axis=1)
    assert distances == pytest.approx(np.full(len(sides), RADIUS), abs=1e-4)


def test_the_true_surface_has_no_error_and_a_raised_one_has_its_height(judge: Judge):
    exact = surface_errors(judge.truth, judge.truth, judge.scene)
    assert exact["found_to_mesh"]["p90"] == exact["mesh_to_found"]["p90"] == 0
    raised = surface_errors(judge.truth + np.array([0, 0, 0.004]), judge.truth, judge.scene)
    assert raised["height"] == pytest.approx([4], abs=0.1)
    assert surface_errors(judge.truth[:0], judge.truth, judge.scene)["found_to_mesh"] is None


def test_a_grasp_on_the_axis_holds_and_one_beside_the_object_does_not(judge: Judge):
    held, beside = judge.grasp(from_above(0.13, 0.16)), judge.grasp(from_above(0.23, 0.16))
    assert (held["reason"], held["off_axis_mm"]) == ("success", pytest.approx(0, abs=0.01))
    assert beside["reason"] == "nothing between the fingers"
    assert (beside["off_axis_mm"], beside["sideways_mm"]) == (pytest.approx(100), pytest.approx(0, abs=0.01))
    surface = surface_errors(judge.truth, judge.truth, judge.scene)
    grasps = [one | {"good_enough": True} for one in (held, beside)] + [beside | {"good_enough": False}]
    table = table_of({"mine": {"one": {"surface": surface, "grasps": grasps}}})
    assert table.splitlines()[-1].startswith("| mine | all | 0.0 / 0.0 | 0.0 / 0.0 | +0.0 |")
    assert "1 of 2" in table


def test_a_scene_without_truth_is_named(folder: Path, tmp_path: Path):
    (tmp_path / "objects").mkdir()
    write_scene(tmp_path / "two", RealScene.read(folder / "one", Meshes(folder / "objects", tmp_path)).views)
    with pytest.raises(InputError, match=r"two/ground_truth\.json: needs 'objects'"):
        RealScene.read(tmp_path / "two", Meshes(folder / "objects", tmp_path))
