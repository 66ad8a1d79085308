"""Records: what is written comes back, the same record gives the same bytes, damage is named."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from PIL import Image as Picture
from record_strategies import assert_same, records, records_without_photos

from neugrasp.data import records as module
from neugrasp.data.add_distance import add_distance
from neugrasp.data.records import Record, read_record, write_record
from neugrasp.data.scene_folder import read_scene
from neugrasp.data.trials import State, Trials
from neugrasp.data.world import Scene
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.geometry.workspace import Workspace

FEW = settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture
def record() -> Record:
    found: list[Record] = []

    @settings(max_examples=1, derandomize=True, database=None, deadline=None)
    @given(records())
    def keep(example: Record) -> None:
        found.append(example)

    keep()
    return found[0]


@pytest.mark.slow
@FEW
@given(records() | records_without_photos())
def test_a_record_comes_back_as_it_was(record: Record) -> None:
    with TemporaryDirectory() as folder:
        path = Path(folder) / record.name
        write_record(path, record)
        assert_same(read_record(path), record)
        assert [entry.name for entry in Path(folder).iterdir()] == [record.name]


@pytest.mark.slow
@settings(FEW, max_examples=5)
@given(records())
def test_the_same_record_gives_the_same_bytes(record: Record) -> None:
    with TemporaryDirectory() as folder:
        contents = []
        for name in ("a", "b"):
            path = Path(folder) / name / record.name
            write_record(path, record)
            files = sorted(file for file in path.rglob("*") if file.is_file())
            contents.append([(str(file.relative_to(path)), file.read_bytes()) for file in files])
        assert contents[0] == contents[1]


def test_a_record_is_a_scene_that_any_detector_reads(record: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "scene", record)
    views = read_scene(tmp_path / "scene")
    assert len(views) == len(record.cameras)
    np.testing.assert_array_equal(views.frames[0].image, record.images[0])
    np.testing.assert_array_equal(views.frames[0].background, record.backgrounds[0])
    assert views.frames[0].camera.sensed == record.cameras[0].sensed
    assert len(record.views(Workspace())) == len(views)


def test_a_complete_record_is_never_touched_again(record: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "scene", record)
    write_record(tmp_path / "scene", replace(record, images=255 - record.images))
    np.testing.assert_array_equal(read_record(tmp_path / "scene").images, record.images)
    assert len(list(tmp_path.iterdir())) == 1


def test_a_full_disk_leaves_nothing(record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> bytes:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(module, "labels_to_bytes", full)
    with pytest.raises(NeuGraspError, match="No space left on device"):
        write_record(tmp_path / "scenes" / "scene", record)
    assert not list((tmp_path / "scenes").iterdir())


@pytest.mark.parametrize(
    "name",
    ["scene.json", "world.json", "cell.json", "truth.npz", "grasps.npz", "trials.npz", "targets/scene.json"],
)
@pytest.mark.parametrize("damage", ["missing", "cut", "garbage"])
def test_a_damaged_file_is_named(name: str, damage: str, record: Record, tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    write_record(folder, replace(record, trials=some_trials()))
    path = folder / name
    if damage == "missing":
        path.unlink()
        if name == "trials.npz":
            assert read_record(folder).trials is None
            return
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    else:
        path.write_bytes(b"\x00\x01garbage\xff" * 10)
    with pytest.raises(InputError) as caught:
        read_record(folder)
    assert str(path) in str(caught.value)


def some_trials() -> Trials:
    """Trials of one grasp."""
    column = np.zeros(1, np.uint8)
    return Trials(
        positions=np.zeros((1, 3), np.float32),
        quaternions=np.zeros((1, 4), np.float32),
        widths=np.zeros(1, np.float32),
        success=np.zeros(1, np.bool_),
        reasons=column,
        states=column,
        series=column,
        reason_names=("slipped",),
        met=(State(Scene("pile", 0, ()), np.zeros((40, 40, 40), np.float32)),),
        made=({"source": "labels"},),
    )


def grid(scene: Scene) -> np.ndarray:
    """Something that depends on the scene."""
    return np.random.default_rng(scene.seed).uniform(-1, 1, (40, 40, 40)).astype(np.float32)


def test_a_mesh_distance_is_added_once_and_changes_nothing_else(record: Record, tmp_path: Path) -> None:
    folder = tmp_path / record.name
    write_record(folder, replace(record, distance=None))
    assert read_record(folder).distance is None
    assert add_distance(folder, grid)
    added = (folder / "truth.npz").read_bytes()
    assert_same(read_record(folder), replace(record, distance=read_record(folder).distance))
    # Half precision: a fourth of a thousandth at most, 8 micrometres.
    np.testing.assert_allclose(read_record(folder).distance, grid(record.scene), atol=2.5e-4)
    assert not add_distance(folder, lambda scene: -grid(scene))
    assert (folder / "truth.npz").read_bytes() == added
    # The same bytes as of a record that had it from the start.
    write_record(tmp_path / "whole", replace(record, distance=grid(record.scene)))
    assert (tmp_path / "whole" / "truth.npz").read_bytes() == added


def test_a_full_disk_leaves_the_truth_as_it_was(
    record: Record, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_record(tmp_path / "scene", replace(record, distance=None))
    before = {path: path.stat().st_size for path in tmp_path.rglob("*")}

    def full(path: Path, data: bytes) -> int:
        path.touch()
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    with pytest.raises(NeuGraspError, match=r"truth\.npz.*No space left on device"):
        add_distance(tmp_path / "scene", grid)
    assert {path: path.stat().st_size for path in tmp_path.rglob("*")} == before
    assert read_record(tmp_path / "scene").distance is None


def test_a_mesh_distance_of_another_shape_is_named(record: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "scene", replace(record, distance=np.zeros((40, 40, 39), np.float32)))
    with pytest.raises(InputError, match="distance has shape"):
        read_record(tmp_path / "scene")


def test_arrays_that_do_not_fit_are_named(record: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "scene", replace(record, masks=record.masks[:, :-1]))
    with pytest.raises(InputError, match="masks has shape"):
        read_record(tmp_path / "scene")


def test_an_image_of_another_size_is_named(record: Record, tmp_path: Path) -> None:
    write_record(tmp_path / "scene", record)
    path = tmp_path / "scene" / "images" / "0.png"
    Picture.new("RGB", (64, 64)).save(path)
    with pytest.raises(InputError, match="background"):
        read_record(tmp_path / "scene")


@pytest.mark.slow
def test_records_are_read_without_blender_pybullet_and_torch() -> None:
    code = (
        "import sys, neugrasp.data.records, neugrasp.data.shards; "
        "assert not {'bpy', 'pybullet', 'torch'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
