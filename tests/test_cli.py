"""The program: what it prints, what it leaves behind, and how it ends."""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

import neugrasp
from ball_record import ball_record
from neugrasp import cli
from neugrasp.data.scene_folder import write_scene
from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.errors import InputError
from neugrasp.geometry.pose import rigid
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Views

DOWN = np.diag([1.0, -1.0, -1.0])


class FlatTable:
    """A detector that sees an empty table and two grasps, or none."""

    def __init__(self, count: int = 2):
        self.gripper = Gripper.load("panda")
        self.count = count

    def detect(self, views: Views) -> Detection:
        height = views.workspace.voxel_centres()[..., 2] - views.workspace.table_height
        tsdf = (height / views.workspace.truncation).clip(-1, 1).astype(np.float32)
        grasps = Grasps.of(
            Grasp(rigid(DOWN, (0.15, 0.15, 0.06)), 0.04, 0.95 - 0.01 * i) for i in range(self.count)
        )
        seconds = {"images": 0.1, "selection": 0.02}
        return Detection(
            grasps, views.workspace, self.gripper, tsdf, {"too_narrow": 7}, 0.5, None, seconds, views.source
        )


@pytest.fixture
def scene_folder(tmp_path: Path) -> Path:
    """A capture that the doctor calls green."""
    write_scene(tmp_path / "scene", ball_record(size=256).views())
    return tmp_path / "scene"


@pytest.fixture
def flat_table(monkeypatch: pytest.MonkeyPatch) -> FlatTable:
    detector = FlatTable()
    monkeypatch.setattr(NeuGraspDetector, "load", classmethod(lambda *_, **__: detector))
    return detector


@pytest.mark.slow
def test_predict_writes_its_four_files_and_says_where(
    scene_folder: Path, tmp_path: Path, flat_table: FlatTable, capsys: pytest.CaptureFixture[str]
):
    out = tmp_path / "out"
    assert cli.main(["predict", str(scene_folder), "--out", str(out)]) == 0
    assert sorted(file.name for file in out.iterdir()) == [
        "grasps.json",
        "overlay.png",
        "surface.ply",
        "tsdf.npz",
    ]
    assert [grasp["score"] for grasp in json.loads((out / "grasps.json").read_text())["grasps"]] == [
        0.95,
        0.94,
    ]
    printed = capsys.readouterr().out
    assert "2 grasps, the best with score 0.95" in printed
    assert str(out / "overlay.png") in printed


@pytest.mark.slow
def test_predict_hands_the_threshold_to_the_detector(
    scene_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    asked: list[object] = []
    load = NeuGraspDetector.load

    def loaded(*arguments: str, **options: object) -> object:
        asked.append(options["threshold"])
        load(*arguments, **options)  # type: ignore[arg-type]
        return FlatTable()

    monkeypatch.setattr(NeuGraspDetector, "load", loaded)
    arguments = ["predict", str(scene_folder), "--out"]
    assert cli.main([*arguments, str(tmp_path / "a")]) == 0
    assert cli.main([*arguments, str(tmp_path / "b"), "--threshold", "0.5"]) == 0
    assert cli.main([*arguments, str(tmp_path / "c"), "--threshold", "1.5"]) == 2
    assert asked == [None, 0.5, 1.5]
    assert "threshold 1.5: must lie between 0 and 1" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


@pytest.mark.slow
def test_predict_says_why_there_are_no_grasps(
    scene_folder: Path, tmp_path: Path, flat_table: FlatTable, capsys: pytest.CaptureFixture[str]
):
    flat_table.count = 0
    assert cli.main(["predict", str(scene_folder), "--out", str(tmp_path / "out")]) == 0
    assert "no grasps: 0 of 7: 7 too narrow to be real" in capsys.readouterr().out


def test_a_mistake_of_the_user_ends_with_2_and_one_line(
    tmp_path: Path, flat_table: FlatTable, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["predict", str(tmp_path / "nothing"), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("neugrasp: error: ")
    assert "nothing/scene.json: missing" in error
    assert "Traceback" not in error
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["doctor", "predict"])
def test_a_name_cannot_steer_the_terminal(
    command: str, scene_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    file = scene_folder / "scene.json"
    data = json.loads(file.read_text())
    data["views"][0]["image"] = "images/\x1b[2J\x1b]0;pwn\x07x.png"
    data["not\x1b[2Jknown"] = 1
    file.write_text(json.dumps(data))
    out = ["--out", str(tmp_path / "out")] if command == "predict" else []
    assert cli.main([command, str(scene_folder), *out]) in (1, 2)
    printed = capsys.readouterr()
    assert "\x1b" not in printed.out + printed.err
    assert r"\x1b[2J" in printed.out + printed.err


@pytest.mark.slow
def test_predict_tells_of_a_rotation_tag_as_the_doctor_does(
    scene_folder: Path, tmp_path: Path, flat_table: FlatTable, caplog: pytest.LogCaptureFixture
):
    file = scene_folder / "backgrounds/0.png"
    with Picture.open(file) as picture:
        tags = picture.getexif()
        tags[274] = 6
        picture.save(file, exif=tags)
    cli.main(["predict", str(scene_folder), "--out", str(tmp_path / "out"), "--force"])
    assert "rotation tag" in caplog.text
    assert "EXIF orientation is not 1: backgrounds/0.png is stored turned by 90 degrees" in caplog.text


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file of this process may grow beyond 20 kB."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    signal.signal(signal.SIGXFSZ, handler)


@pytest.mark.slow
def test_a_full_disk_leaves_nothing_half_written(
    scene_folder: Path,
    tmp_path: Path,
    flat_table: FlatTable,
    full_disk: None,
    capsys: pytest.CaptureFixture[str],
):
    out = tmp_path / "out"
    assert cli.main(["predict", str(scene_folder), "--out", str(out)]) == 2
    error = capsys.readouterr().err
    assert error.startswith("neugrasp: error: ")
    assert "Traceback" not in error
    assert not out.exists()


@pytest.mark.slow
def test_out_may_not_be_a_file(
    scene_folder: Path, tmp_path: Path, flat_table: FlatTable, capsys: pytest.CaptureFixture[str]
):
    (tmp_path / "out").write_text("mine")
    assert cli.main(["predict", str(scene_folder), "--out", str(tmp_path / "out")]) == 2
    assert (tmp_path / "out").read_text() == "mine"
    assert "out" in capsys.readouterr().err


@pytest.mark.slow
def test_an_interruption_ends_with_130(
    scene_folder: Path, tmp_path: Path, flat_table: FlatTable, monkeypatch: pytest.MonkeyPatch
):
    def interrupted(*_: object) -> Detection:
        raise KeyboardInterrupt

    monkeypatch.setattr(flat_table, "detect", interrupted)
    assert cli.main(["predict", str(scene_folder), "--out", str(tmp_path / "out")]) == 130
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_weights_that_are_not_there(scene_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    arguments = ["predict", str(scene_folder), "--out", str(tmp_path / "out"), "--weights", "no.safetensors"]
    assert cli.main(arguments) == 2
    assert "no weights 'no.safetensors'" in capsys.readouterr().err


@pytest.mark.slow
def test_the_demo_prints_a_table_and_fills_a_folder_per_scene(
    scene_folder: Path,
    tmp_path: Path,
    flat_table: FlatTable,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    from neugrasp.demo import bundled as demo

    monkeypatch.setattr(demo, "demo_scenes", lambda: [demo.DemoScene("glasses", scene_folder)])
    began = time.monotonic()
    assert cli.main(["demo", "--out", str(tmp_path / "out")]) == 0
    printed = capsys.readouterr().out.splitlines()
    assert printed[0].split() == ["scene", "grasps", "best", "width", "seconds", "pictures"]
    waited = time.monotonic() - began
    *row, seconds, folder = printed[1].split()
    assert row == ["glasses", "2", "0.95", "40", "mm"]
    assert folder == str(tmp_path / "out" / "glasses")
    # What a person waits: the stages of this detector say that they took a tenth of a second.
    assert 0.15 < float(seconds) <= waited + 0.05
    written = {file.name for file in (tmp_path / "out" / "glasses").iterdir()}
    assert written == {"grasps.json", "overlay.png", "surface.ply", "tsdf.npz", "surface.png", "slice.png"}


def test_a_demo_without_scenes_is_an_incomplete_installation(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    from neugrasp.demo import bundled as demo

    monkeypatch.setattr(demo.resources, "files", lambda _: tmp_path)
    with pytest.raises(InputError, match="no bundled scenes; this installation is incomplete"):
        demo.demo_scenes()


@pytest.mark.parametrize("command", ["demo", "predict", "generate", "train"])
def test_every_command_has_help(command: str, capsys: pytest.CaptureFixture[str]):
    with pytest.raises(SystemExit) as ended:
        cli.main([command, "--help"])
    assert ended.value.code == 0
    assert "--out " in capsys.readouterr().out


@pytest.mark.slow
def test_help_comes_without_loading_the_network():
    code = (
        "import sys\nfrom neugrasp import cli\n"
        "try:\n    cli.main(['--help'])\nexcept SystemExit:\n    pass\n"
        "assert not {'torch', 'scipy', 'pybullet', 'bpy'} & set(sys.modules), sorted(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, stdout=subprocess.DEVNULL)


def test_a_bare_call_shows_the_help_with_the_first_commands_first(capsys: pytest.CaptureFixture[str]):
    assert cli.main([]) == 0
    out = capsys.readouterr().out
    assert cli.main(["--help"]) == 0
    assert capsys.readouterr().out == out
    assert all(f"\n  {name:<11}" in out for name in cli.COMMANDS)
    places = [out.index(f"  {name} ") for name in ("demo", "doctor", "predict", "view", "evaluate", "bench")]
    assert places == sorted(places)


def test_the_version(capsys: pytest.CaptureFixture[str]):
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"neugrasp {neugrasp.__version__}\n"


@pytest.mark.parametrize(
    ("word", "hint"),
    [
        ("predictt", "did you mean predict?"),
        ("trainn", "did you mean train?"),
        ("xyz", "choose one of demo, doc"),
    ],
)
def test_a_command_that_is_none(word: str, hint: str, capsys: pytest.CaptureFixture[str]):
    assert cli.main([word, "--out", "x"]) == 2
    assert f"there is no command '{word}'; {hint}" in capsys.readouterr().err


@pytest.mark.parametrize(("old", "new"), cli.RENAMED.items())
def test_an_old_name_of_a_command_is_read_and_said_to_be_old(
    old: str, new: str, capsys: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
):
    def shown(name: str) -> str:
        with pytest.raises(SystemExit) as ended:
            cli.main([name, "--help"])
        assert ended.value.code == 0
        return capsys.readouterr().out

    assert old not in cli.COMMANDS
    assert f"usage: neugrasp {new} " in shown(old)
    assert f"neugrasp {old} is called {new} now" in caplog.text
    caplog.clear()
    shown(new)
    assert not caplog.text


@pytest.mark.parametrize(
    ("former", "now"),
    [("evaluation.measuring_sticks", "evaluation.oracle_baselines"), ("simulation.scene", "data.world")],
)
def test_a_module_that_was_moved_is_found_at_its_former_place(former: str, now: str):
    old, new = (import_module(f"neugrasp.{name}") for name in (former, now))
    assert all(getattr(old, name) is getattr(new, name) for name in old.__all__)


@pytest.mark.parametrize(("name", "tool"), cli.GONE.items())
def test_a_command_that_left_the_program_says_where_it_went(
    name: str, tool: str, capsys: pytest.CaptureFixture[str]
):
    assert cli.main([name, "--out", "x"]) == 2
    assert tool in capsys.readouterr().err
    assert (Path(__file__).parents[1] / tool.split()[-1]).is_file()


@pytest.mark.slow
def test_the_package_runs_as_a_module():
    run = subprocess.run([sys.executable, "-m", "neugrasp", "--version"], capture_output=True, text=True)
    assert run.stdout == f"neugrasp {neugrasp.__version__}\n"
