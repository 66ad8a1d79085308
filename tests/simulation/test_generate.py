"""Generation: the same records whatever the workers, the order and the accidents on the way."""

from __future__ import annotations

import hashlib
import importlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.data.packing import pack
from neugrasp.data.records import read_record
from neugrasp.data.truth_file import OPTIONAL, TRUTH_ARRAYS
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.simulation import generate as generation
from neugrasp.simulation.command import Generate
from neugrasp.simulation.generate import generate
from neugrasp.simulation.lathe import box
from neugrasp.simulation.meshes import write_obj
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import RenderSettings
from neugrasp.simulation.scene_generator import SceneGenerator

HERE = Path(__file__).parent
UNRECORDED = (".lock", ".lock-workers", "timing.json")


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEUGRASP_CACHE", str(tmp_path_factory.mktemp("cache")))
        # Worker processes import the scene renderer by name.
        patch.syspath_prepend(str(HERE))
        yield


@pytest.fixture(scope="module")
def photographers(_cache: object) -> ModuleType:
    return importlib.import_module("noise_renderer")


def small(out: Path, **changes: object) -> Generate:
    config = Generate(
        scene="packed",
        num=3,
        out=out,
        object_sets=("glassware",),
        grasp_points=2,
        scenes_per_cell=2,
        image_size=32,
        seed=4,
        workers=1,
    )
    return replace(config, **changes)  # type: ignore[arg-type]


def digest(out: Path) -> dict[str, str]:
    """Hash of every file that belongs to the data set."""
    files = [path for path in sorted(out.rglob("*")) if path.is_file() and path.name not in UNRECORDED]
    return {str(p.relative_to(out)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory: pytest.TempPathFactory, photographers: ModuleType) -> Path:
    """A data set made by one worker in one go."""
    out = tmp_path_factory.mktemp("undisturbed")
    generate(small(out), photographers.NoiseRenderer)
    return out


@pytest.mark.slow
def test_records_hold_what_was_simulated(undisturbed: Path) -> None:
    records = [read_record(folder) for folder in sorted((undisturbed / "scenes").iterdir())]
    assert [record.name for record in records] == [f"packed-4-{index:06d}" for index in range(3)]
    assert len({record.seed for record in records}) == 3
    for record in records:
        assert record.kind == "packed"
        assert record.images.shape == (4, 32, 32, 3)
        assert record.targets.shape == (2, 32, 32, 3)
        assert len(record.labels.success) == 2
        assert record.scene.bodies
        assert all(body.object_set == "glassware" for body in record.scene.bodies)
        seen = set(np.unique(record.masks)) - {-1, 0}
        assert seen <= set(range(1, len(record.scene.bodies) + 1))
        assert record.distance is not None
        assert record.trials is not None
        assert len(record.trials) == 2 * 6
        assert record.trials.met[0].scene == replace(record.scene, materials=())
        np.testing.assert_array_equal(record.trials.met[0].distance, record.distance)
        assert np.any(record.trials.success) == np.any(record.labels.success)
        # Glassware is hollow and thin; where the fused grid is well in front of it, the mesh is, too.
        assert np.all(record.distance[record.observed & (record.tsdf > 0.9)] > 0)
        # The table plane, 5 cm above the floor of the cube, is the surface in most columns.
        table = record.tsdf[:, :, 6]
        assert np.abs(np.median(table)) < 0.3
    assert np.array_equal(records[0].backgrounds, records[1].backgrounds)
    assert not np.array_equal(records[1].backgrounds, records[2].backgrounds)


@pytest.mark.slow
def test_a_data_set_made_without_mesh_distances_is_given_those_it_would_have(
    undisturbed: Path, tmp_path: Path
) -> None:
    old = tmp_path / "old"
    shutil.copytree(undisturbed, old)
    for path in old.glob("scenes/*/truth.npz"):
        kinds = {name: kind for name, kind in TRUTH_ARRAYS.items() if name not in OPTIONAL}
        arrays = npz_arrays(path.read_bytes(), kinds, str(path))
        path.write_bytes(npz_bytes(**arrays))
    assert digest(old) != digest(undisturbed)
    program = [sys.executable, HERE.parents[1] / "benchmarks" / "add_distance.py", old, "--sets", "glassware"]
    for told in ("3 of 3 records, 0 had it, 0 failed", "3 of 3 records, 3 had it, 0 failed"):
        done = subprocess.run(program, capture_output=True, text=True, check=True)
        assert told in done.stdout
    made = {name: hash for name, hash in digest(old).items() if not name.startswith(".")}
    assert made == digest(undisturbed)


@pytest.mark.slow
def test_trials_are_added_once_and_change_nothing_else(undisturbed: Path, tmp_path: Path) -> None:
    out = tmp_path / "more"
    shutil.copytree(undisturbed, out)
    (out / "scenes" / "packed-4-000001" / "trials.npz").unlink()
    program = [sys.executable, HERE.parents[1] / "benchmarks" / "add_trials.py", out, "--sets", "glassware"]
    before, options = digest(out), ["--points", "4", "--removed", "0,1"]
    for told in ("3 of 3 records, 0 had it, 0 failed", "3 of 3 records, 3 had it, 0 failed"):
        done = subprocess.run([*program, *options], capture_output=True, text=True, check=True)
        assert told in done.stdout
    after = {name: hash for name, hash in digest(out).items() if not name.startswith(".")}
    changed = {name for name, hash in after.items() if before.get(name) != hash}
    assert changed == {f"scenes/packed-4-{index:06d}/trials.npz" for index in range(3)}
    for path in sorted((out / "scenes").iterdir()):
        record = read_record(path)
        assert record.trials is not None
        assert record.trials.met[0].scene == replace(record.scene, materials=())
        sources = [series["source"] for series in record.trials.made]
        assert sources == (["states"] if path.name.endswith("1") else ["labels", "states"])
        assert np.sum(record.trials.series == len(sources) - 1) == len(record.trials.met) * 4 * 6


@pytest.mark.slow
def test_two_workers_give_the_same_bytes(
    undisturbed: Path, tmp_path: Path, photographers: ModuleType
) -> None:
    generate(small(tmp_path, workers=2), photographers.NoiseRenderer)
    assert digest(tmp_path) == digest(undisturbed)


@pytest.mark.slow
def test_the_order_of_scenes_makes_no_difference(
    undisturbed: Path, tmp_path: Path, photographers: ModuleType
) -> None:
    generator = SceneGenerator(small(tmp_path), photographers.NoiseRenderer(1))
    with generator.world:
        folders = [generator.make(index) for index in (2, 0)]
    expected = digest(undisturbed)
    for folder in folders:
        made = digest(folder)
        assert made == {name: expected[f"scenes/{folder.name}/{name}"] for name in made}


@pytest.mark.slow
def test_a_longer_run_begins_with_the_shorter_one(
    undisturbed: Path, tmp_path: Path, photographers: ModuleType
) -> None:
    generate(small(tmp_path, num=1), photographers.NoiseRenderer)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "scenes").rglob("*")}
    generate(small(tmp_path), photographers.NoiseRenderer)
    assert digest(tmp_path) == digest(undisturbed)
    assert all(path.stat().st_mtime_ns == mtime for path, mtime in before.items())


@pytest.mark.slow
def test_without_photos_the_same_scenes_and_labels_come(
    undisturbed: Path, tmp_path: Path, photographers: ModuleType
) -> None:
    bare = [read_record(path) for path in generate(small(tmp_path, photos=False, workers=2))]
    full = [read_record(path) for path in sorted((undisturbed / "scenes").iterdir())]
    for one, other in zip(bare, full, strict=True):
        assert not one.has_photos
        assert one.scene == other.scene
        np.testing.assert_array_equal(one.tsdf, other.tsdf)
        np.testing.assert_array_equal(one.labels.success, other.labels.success)
        np.testing.assert_array_equal(one.labels.quaternions, other.labels.quaternions)
    with pytest.raises(InputError, match="photos = False"):
        generate(small(tmp_path), photographers.NoiseRenderer)


SCRIPT = """
    import sys
    from pathlib import Path
    sys.path.insert(0, {here!r})
    from noise_renderer import SlowRenderer
    from neugrasp.simulation.command import Generate
    from neugrasp.simulation.generate import generate
    if __name__ == "__main__":
        generate({config!r}, SlowRenderer)
"""


@pytest.mark.slow
@pytest.mark.parametrize("kills", [3, 20])
def test_killed_at_any_moment_it_goes_on_to_the_same_bytes(
    kills: int, undisturbed: Path, tmp_path: Path, photographers: ModuleType
) -> None:
    out = tmp_path / "out"
    script = tmp_path / "run.py"
    config = repr(small(out, workers=2)).replace("PosixPath", "Path")
    script.write_text(
        textwrap.dedent(SCRIPT).replace("{config!r}", config).replace("{here!r}", repr(str(HERE)))
    )
    rng = np.random.default_rng(0)
    for _ in range(kills):
        process = subprocess.Popen([sys.executable, script], start_new_session=True)
        time.sleep(rng.uniform(0.3, 2.5))
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
        for folder in (out / "scenes").glob("[!.]*"):
            read_record(folder)
    generate(small(out), photographers.NoiseRenderer)
    assert digest(out) == digest(undisturbed)


def test_another_configuration_is_refused(undisturbed: Path, photographers: ModuleType) -> None:
    before = digest(undisturbed)
    with pytest.raises(InputError, match=r"dataset.json.*seed = 4, not 5"):
        generate(small(undisturbed, seed=5), photographers.NoiseRenderer)
    with pytest.raises(InputError, match="materials = 'mixed', not 'diffuse'"):
        generate(small(undisturbed, materials="diffuse"), photographers.NoiseRenderer)
    assert digest(undisturbed) == before


@pytest.fixture
def own_files(tmp_path: Path) -> dict[str, Path]:
    """A gripper and a folder of objects of the user's own."""
    gripper = tmp_path / "mine.json"
    gripper.write_text((Path(str(resources.files("neugrasp"))) / "grippers" / "panda.json").read_text())
    objects = tmp_path / "objects"
    write_obj(objects / "brick.obj", (box(np.array([0.02, 0.02, 0.04])),))
    for i in range(12):
        (objects / f"brick{i}.urdf").write_text(BRICK)
    return {"gripper": gripper, "objects": objects}


BRICK = """<robot name="brick"><link name="base">
<inertial><mass value="0.1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>
<visual><geometry><mesh filename="brick.obj"/></geometry></visual>
<collision><geometry><mesh filename="brick.obj"/></geometry></collision></link></robot>"""


def own(tmp_path: Path, own_files: dict[str, Path], **changes: Any) -> Generate:
    files = {"gripper": str(own_files["gripper"]), "objects": own_files["objects"], "object_sets": ()}
    return small(tmp_path / "out", **{"photos": False, "num": 1, **files, **changes})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("file", "old", "new", "named"),
    [
        ("gripper", '"max_opening": 0.08', '"max_opening": 0.02', "gripper_sha256"),
        ("objects", "0.0800000", "0.0810000", "objects_content_sha256"),
        ("urdf", 'mass value="0.1"', 'mass value="0.2"', "objects_content_sha256"),
    ],
)
def test_a_run_does_not_go_on_with_other_files_of_the_same_name(
    tmp_path: Path, own_files: dict[str, Path], file: str, old: str, new: str, named: str
) -> None:
    """One data set never holds the labels of two grippers, or two shapes under one name."""
    config = own(tmp_path, own_files)
    generate(config)
    before = digest(config.out)
    changed = {
        "gripper": own_files["gripper"],
        "objects": own_files["objects"] / "brick.obj",
        "urdf": own_files["objects"] / "brick3.urdf",
    }[file]
    text = changed.read_text()
    assert old in text
    changed.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=f"dataset.json.*made with {named} = "):
        generate(replace(config, num=2))
    assert digest(config.out) == before
    changed.write_text(text)
    assert len(generate(replace(config, num=2))) == 2


@pytest.mark.slow
def test_a_data_set_from_before_the_hashes_goes_on(tmp_path: Path, own_files: dict[str, Path]) -> None:
    config = own(tmp_path, own_files)
    generate(config)
    file = config.out / "dataset.json"
    described = json.loads(file.read_text())
    for key in ("gripper_sha256", "objects_content_sha256"):
        described.pop(key)
    file.write_text(json.dumps(described))
    assert len(generate(replace(config, num=2))) == 2
    file.write_text(json.dumps(described | {"seed": 99}))
    with pytest.raises(InputError, match="seed = 99"):
        generate(config)


@pytest.mark.slow
def test_a_damaged_record_is_made_again_as_its_message_says(
    tmp_path: Path, own_files: dict[str, Path]
) -> None:
    config = own(tmp_path, own_files)
    (folder,) = generate(config)
    before = digest(config.out)
    (folder / "grasps.npz").write_bytes((folder / "grasps.npz").read_bytes()[:100])
    with pytest.raises(
        InputError, match=r"grasps\.npz: damaged .*delete .* and run `neugrasp generate`"
    ) as caught:
        pack([config.out / "scenes"], tmp_path / "packed")
    (told,) = re.findall(r"delete (\S+) and run", str(caught.value))
    shutil.rmtree(told)
    generate(config)
    assert digest(config.out) == before
    pack([config.out / "scenes"], tmp_path / "packed")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"scene": "heap"}, "choose one of single, pile, packed"),
        ({"num": 0}, "--num 0; it must be at least 1"),
        ({"views": "orbit"}, "--views 'orbit'"),
        ({"gripper": "hook"}, "hook"),
        ({"seed": -1}, "--seed -1"),
        ({"targets": 5}, "--targets 5; a work cell has 1 to 4"),
        ({"samples": 6}, "--samples 6; it must be a power of two"),
    ],
)
def test_options_that_cannot_be_used(
    changes: dict[str, object], message: str, tmp_path: Path, photographers: ModuleType
) -> None:
    with pytest.raises(InputError, match=message):
        generate(small(tmp_path / "out", **changes), photographers.NoiseRenderer)
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_more_targets_leave_all_else_as_it_is(
    undisturbed: Path, tmp_path: Path, photographers: ModuleType
) -> None:
    (few, more) = (
        read_record(folder)
        for folder in (
            sorted((undisturbed / "scenes").iterdir())[0],
            generate(small(tmp_path, num=1, targets=4), photographers.NoiseRenderer)[0],
        )
    )
    assert (len(few.targets), len(more.targets)) == (2, 4)
    np.testing.assert_array_equal(few.images, more.images)
    np.testing.assert_array_equal(few.labels.points, more.labels.points)
    assert more.cell["targets"] == [4, 5, 6, 7]


@pytest.mark.slow
def test_samples_reach_the_renderer(
    tmp_path: Path, photographers: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = []

    def renderer(threads: int, settings: RenderSettings) -> object:
        asked.append(settings.samples)
        return photographers.NoiseRenderer(threads)

    monkeypatch.setattr(generation, "Renderer", renderer)
    generate(small(tmp_path / "many", num=1, samples=8))
    generate(small(tmp_path / "usual", num=1))
    assert asked == [8, 4]
    described = [json.loads((tmp_path / name / "dataset.json").read_text()) for name in ("many", "usual")]
    assert [one["samples"] for one in described] == [8, 4]


@pytest.mark.slow
def test_two_runs_do_not_write_into_one_folder(tmp_path: Path, photographers: ModuleType) -> None:
    with generation._only_one(tmp_path), pytest.raises(InputError, match="another neugrasp generate"):
        generate(small(tmp_path), photographers.NoiseRenderer)


def test_a_cache_that_cannot_be_written_is_named_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Not the folder of the data set, and not after twenty other arrangements."""
    monkeypatch.setenv("NEUGRASP_CACHE", str(tmp_path / "file" / "cache"))
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(NeuGraspError, match=r"file/cache/objects/.*: cannot be written \(Not a directory\)"):
        generate(small(tmp_path / "out", photos=False, seed=77))
    assert "drawn anew" not in caplog.text


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_a_full_disk_is_one_clear_error_and_leaves_nothing_half_written(
    workers: int, tmp_path: Path, photographers: ModuleType
) -> None:
    with pytest.raises(NeuGraspError, match="No space left on device"):
        generate(small(tmp_path, workers=workers), photographers.FullDisk)
    assert not list((tmp_path / "scenes").glob("*"))


@pytest.mark.slow
def test_an_arrangement_that_fails_is_drawn_anew_and_never_dropped(
    tmp_path: Path, photographers: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    from neugrasp.simulation import scene_generator as module

    real, tried = module.arrange, []

    def stubborn(kind: str, seed: int, world: World, choices: object) -> object:
        tried.append(seed)
        scene = real(kind, seed, world, choices)  # type: ignore[arg-type]
        return replace(scene, bodies=()) if len(tried) < 3 else scene

    monkeypatch.setattr(module, "arrange", stubborn)
    (folder,) = generate(small(tmp_path, num=1), photographers.NoiseRenderer)
    assert len(set(tried)) == 3
    assert read_record(folder).seed == tried[-1]


def test_timing_is_told_by_stage(undisturbed: Path) -> None:
    timing = json.loads((undisturbed / "timing.json").read_text())
    assert timing["scenes"] == 3
    assert {"arrange", "depth", "tsdf", "distance", "grasps", "render", "write"} <= set(
        timing["seconds_per_scene"]
    )
