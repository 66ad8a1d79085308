"""A cube of another size and resolution: learned, written down, detected in, and kept apart from others."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ball_record import ball_record
from neugrasp.data.packing import pack
from neugrasp.data.records import read_record, write_record
from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.data.shards import Shards
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.training.command import Train
from neugrasp.training.recipes import recipe
from neugrasp.training.trainer import train

CUBE = Workspace.with_edge(0.24, 24)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    for seed in range(2):
        record = ball_record(x=0.11 + 0.02 * seed, y=0.12, seed=seed, workspace=CUBE)
        write_record(tmp_path / "data" / "scenes" / record.name, record)
    return tmp_path / "data"


def test_a_signed_distance_of_one_stays_four_voxels():
    assert CUBE.truncation == pytest.approx(4 * CUBE.voxel_size)
    assert Workspace.with_edge(USUAL.size, USUAL.resolution).cube == USUAL.cube
    assert USUAL.unusual() == {}
    with pytest.raises(InputError, match="the cube: resolution is 20; it must be a multiple of 8"):
        Workspace.with_edge(0.3, 20)


@pytest.mark.slow
def test_it_trains_and_detects_and_no_other_cube_is_taken_for_it(data: Path, tmp_path: Path):
    run = Train(recipe="tiny", data=(data,), validation=(data,), out=tmp_path / "out", steps=3, loaders=0)
    weights = train(run, config=replace(recipe("tiny"), steps=3, head_steps=1))
    detector = NeuGraspDetector.load(weights, threshold=0.0)
    assert detector.model.workspace.cube == CUBE.cube
    views = read_record(data / "scenes" / "ball-0").views()
    found = detector.detect(views)
    assert (found.grid().shape, found.workspace.cube) == ((24, 24, 24), CUBE.cube)
    inside = found.workspace.contains(found.grasps.positions - 0.05 * found.grasps.poses[:, :3, 2])
    assert len(inside) == len(found.grasps)
    with pytest.raises(InputError, match=r"these weights were trained for a cube of 0\.24 m with 24 voxels"):
        detector.detect(ball_record().views())
    with pytest.raises(InputError, match=r"a cube of 0\.24 m"):
        NeuGraspDetector.load("neugrasp").detect(views)


def test_two_cubes_in_one_run_are_refused(data: Path, tmp_path: Path):
    other = ball_record(seed=7)
    write_record(data / "scenes" / other.name, other)
    run = Train(recipe="tiny", data=(data,), validation=(data,), out=tmp_path / "out", steps=3, loaders=0)
    with pytest.raises(InputError, match=r"ball-7: is about a cube of 0\.3 m .* the first scene is about"):
        train(run, config=replace(recipe("tiny"), steps=6, head_steps=6))


def test_files_keep_the_cube(data: Path, tmp_path: Path):
    record = read_record(data / "scenes" / "ball-0")
    assert record.workspace.cube == CUBE.cube
    assert read_scene(data / "scenes" / "ball-0").workspace.cube == CUBE.cube
    pack([data / "scenes"], tmp_path / "shards")
    packed = Shards(tmp_path / "shards").read(0)
    assert packed.workspace.cube == CUBE.cube
    assert np.array_equal(packed.tsdf, record.tsdf)
    write_scene(tmp_path / "usual", ball_record().views())
    assert "resolution" not in (tmp_path / "usual" / "scene.json").read_text()
