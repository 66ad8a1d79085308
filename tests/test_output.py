"""What is written is whole or not there, in its place, and never over what was read."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from pathlib import Path

import numpy as np
import pytest

import results as results_page
from ball_record import ball_record
from neugrasp import cli
from neugrasp.data.scene_folder import write_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.contract import Detection
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.files import FILES, write_grasps, write_surface
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.geometry.pose import rigid
from neugrasp.geometry.surface import Surface
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.observation import Views
from neugrasp.output import whole_file, write_text
from neugrasp.run_folder import lock_folder
from neugrasp.training.recipes import tiny

DOWN = np.diag([1.0, -1.0, -1.0])
GRASPS = [Grasp(rigid(DOWN, (0.15, 0.15, 0.06)), 0.04, 0.95)]
TOO_LONG = "n" * 256


def tree(folder: Path) -> dict[str, bytes]:
    """Every file below a folder, hidden ones too."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


class FlatTable:
    """A detector that sees an empty table, counts how often it was asked, and may say no."""

    def __init__(self) -> None:
        self.gripper, self.asked = Gripper.load("panda"), 0
        self.after = lambda: None

    def detect(self, views: Views) -> Detection:
        self.asked += 1
        height = views.workspace.voxel_centres()[..., 2] - views.workspace.table_height
        tsdf = (height / views.workspace.truncation).clip(-1, 1).astype(np.float32)
        self.after()
        grasps, seconds = Grasps.of(GRASPS), {"images": 0.1}
        return Detection(
            grasps, views.workspace, self.gripper, tsdf, {"too_narrow": 7}, 0.5, None, seconds, views.source
        )


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    write_scene(tmp_path / "scene", ball_record(size=256).views())
    return tmp_path / "scene"


@pytest.fixture
def detector(monkeypatch: pytest.MonkeyPatch) -> FlatTable:
    made = FlatTable()
    monkeypatch.setattr(NeuGraspDetector, "load", classmethod(lambda *_, **__: made))
    return made


@pytest.fixture
def grasps(tmp_path: Path) -> Path:
    (tmp_path / "prediction").mkdir()
    write_grasps(tmp_path / "prediction" / "grasps.json", GRASPS, {"gripper": "panda"})
    return tmp_path / "prediction" / "grasps.json"


@pytest.fixture
def full_disk() -> Iterator[None]:
    """No file of this process may grow beyond 1 kB."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    signal.signal(signal.SIGXFSZ, handler)


def test_a_file_appears_at_once_and_leaves_nothing_beside_it(tmp_path: Path):
    with whole_file(tmp_path / "new" / "a.txt") as part:
        assert part.suffix == ".txt"
        part.write_text("a")
        assert not (tmp_path / "new" / "a.txt").exists()
    assert tree(tmp_path) == {"new/a.txt": b"a"}


def test_after_a_failure_the_older_file_is_there_and_new_folders_are_gone(tmp_path: Path):
    write_text(tmp_path / "a.txt", "old")
    for path in (tmp_path / "a.txt", tmp_path / "deep" / "er" / "a.txt"):
        with suppress(ZeroDivisionError), whole_file(path) as part:
            part.write_text("new")
            raise ZeroDivisionError
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]
    assert (tmp_path / "a.txt").read_text() == "old"


def test_a_full_disk_names_the_file(tmp_path: Path, full_disk: None):
    with pytest.raises(NeuGraspError, match=r"a\.txt: cannot be written \(File too large\)"):
        write_text(tmp_path / "a.txt", "x" * 2000)
    with (
        pytest.raises(NeuGraspError, match=r"out.*: cannot be written \(File too large\)"),
        whole_or_nothing(tmp_path / "out") as part,
    ):
        (part / "b.txt").write_text("x" * 2000)
    with pytest.raises(NeuGraspError, match=r"w\.safetensors: cannot be written"):
        save_checkpoint(tmp_path / "w.safetensors", NeuGrasp(tiny().model), {})
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_is_read_keeps_its_own_name_in_an_error(tmp_path: Path):
    """What cannot be read elsewhere is not what cannot be written."""
    with pytest.raises(FileNotFoundError, match="elsewhere"), whole_file(tmp_path / "a.txt"):
        (tmp_path / "elsewhere").read_text()
    with pytest.raises(FileNotFoundError, match="elsewhere"), whole_or_nothing(tmp_path / "out"):
        (tmp_path / "elsewhere").read_text()


def test_what_a_killed_run_left_is_gone_when_the_next_one_holds_the_folder(tmp_path: Path):
    """And nobody takes it for a file of the run meanwhile."""
    out = tmp_path / "out"
    write_text(out / "rounds" / "000000.json", "{}")
    unfinished = []
    for folder in (out, out / "rounds"):
        unfinished += [whole_file(folder / "000001.json"), whole_or_nothing(folder)]
        unfinished[-2].__enter__().write_text("half")
        (unfinished[-1].__enter__() / "x.json").write_text("half")
    assert [file.name for file in (out / "rounds").glob("[!.]*.json")] == ["000000.json"]
    with lock_folder(out, "evaluate"):
        assert tree(out).keys() == {".lock", "rounds/000000.json"}


@pytest.mark.parametrize("spoiled", ["a.txt", "b.txt", "c.txt"])
def test_a_folder_in_a_file_s_place_leaves_the_whole_older_set(tmp_path: Path, spoiled: str):
    """All of them or none: also where the last of them cannot be put in its place."""
    names = ("a.txt", "b.txt", "c.txt")
    for name in names:
        (tmp_path / name).write_text("old")
    before = tree(tmp_path)

    def spoil_and_write() -> None:
        with whole_or_nothing(tmp_path) as part:
            for name in names:
                (part / name).write_text("new")
            (tmp_path / spoiled).unlink()
            (tmp_path / spoiled).mkdir()

    with pytest.raises(InputError, match=f"{spoiled}: is a folder"):
        spoil_and_write()
    assert tree(tmp_path) == {name: text for name, text in before.items() if name != spoiled}


def test_a_move_that_fails_is_taken_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    names = ("a.txt", "b.txt", "c.txt")
    for name in names:
        (tmp_path / name).write_text("old")
    before, rename = tree(tmp_path), Path.rename

    def failing(self: Path, target: Path) -> Path:
        if self.parent.name.startswith(".part-") and target == tmp_path / "b.txt":
            raise OSError(5, "Input/output error")
        return rename(self, target)

    def write() -> None:
        with whole_or_nothing(tmp_path, names) as part:
            for name in names:
                (part / name).write_text("new")
            monkeypatch.setattr(Path, "rename", failing)

    with pytest.raises(NeuGraspError, match=r"b\.txt: cannot be written \(Input/output error\)"):
        write()
    assert tree(tmp_path) == before


def test_whoever_finds_the_first_file_finds_its_companions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """At no moment do old and new files lie together, nor does the first lie there without the others."""
    names = ("first.txt", "a.txt", "z.txt")
    seen: list[dict[str, bytes]] = []
    rename = Path.rename

    def watched(self: Path, target: Path) -> Path:
        moved = rename(self, target)
        seen.append({p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()})
        return moved

    monkeypatch.setattr(Path, "rename", watched)
    for text in ("old", "new"):
        with whole_or_nothing(tmp_path, names) as part:
            for name in names:
                (part / name).write_text(text)
    assert len(seen) == 9
    for found in seen:
        assert len(set(found.values())) <= 1
        assert "first.txt" not in found or set(found) == set(names)


@pytest.mark.slow
def test_what_an_earlier_run_wrote_more_is_gone_and_what_is_not_its_own_stays(
    tmp_path: Path, scene: Path, detector: FlatTable
):
    """A report, or the demo's pictures, of another scene never lie beside new grasps."""
    out = tmp_path / "out"
    assert cli.main(["predict", str(scene), "--out", str(out)]) == 0
    for name in ("report.html", "surface.png", "slice.png", "mine.txt"):
        (out / name).write_text("older")
    assert cli.main(["predict", str(scene), "--out", str(out)]) == 0
    assert {file.name for file in out.iterdir()} == {*FILES[:4], "mine.txt"}


OUTS = {
    "a file": lambda folder: (folder / "out").write_text("mine"),
    "below a file": lambda folder: (folder / "a").write_text("mine"),
    "too long": lambda _folder: None,
    "a folder in the place of a file": lambda folder: (folder / "out" / "overlay.png").mkdir(parents=True),
}


@pytest.mark.parametrize("kind", OUTS)
def test_a_prediction_that_cannot_be_written_is_not_made(
    kind: str, tmp_path: Path, scene: Path, detector: FlatTable, capsys: pytest.CaptureFixture[str]
):
    OUTS[kind](tmp_path)
    out = {"below a file": tmp_path / "a" / "out", "too long": tmp_path / TOO_LONG}.get(
        kind, tmp_path / "out"
    )
    before = tree(tmp_path)
    assert cli.main(["predict", str(scene), "--out", str(out)]) == 2
    assert str(out) in capsys.readouterr().err
    assert detector.asked == 0
    assert tree(tmp_path) == before


COMMANDS = {
    "doctor": ["doctor", "SCENE", "--report", "OUT.html"],
    "export": ["export", "GRASPS", "--format", "ros", "--out", "OUT.json"],
    "export vgn": ["export", "GRASPS", "--format", "vgn", "--out", "OUT.csv"],
    "board": ["board", "--out", "OUT.pdf"],
    "board as a picture": ["board", "--out", "OUT.png"],
    "results": ["results", "--folder", "RESULTS", "--out", "OUT.md"],
}


def run_command(command: str, out: Path, scene: Path, grasps: Path) -> int:
    if command.startswith("board"):
        pytest.importorskip("cv2")
    results = Path(__file__).parents[1] / "docs" / "results"
    places = {"SCENE": scene, "GRASPS": grasps, "RESULTS": results}
    words = [str(places.get(word, word)) for word in COMMANDS[command]]
    words = [w.replace("OUT", str(out)) if w.startswith("OUT") else w for w in words]
    return results_page.main(words[1:]) if command == "results" else cli.main(words)


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_one_file_is_written_whole_into_a_new_folder(command: str, tmp_path: Path, scene: Path, grasps: Path):
    assert run_command(command, tmp_path / "new" / "out", scene, grasps) == 0
    (file,) = (tmp_path / "new").iterdir()
    assert file.stat().st_size > 50


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", ["a folder", "below a file", "too long", "full disk"])
def test_one_file_that_cannot_be_written_is_named_and_changes_nothing(
    command: str,
    kind: str,
    tmp_path: Path,
    scene: Path,
    grasps: Path,
    request: pytest.FixtureRequest,
    capsys: pytest.CaptureFixture[str],
):
    out = tmp_path / "new" / "out"
    suffix = COMMANDS[command][-1].removeprefix("OUT")
    if kind == "a folder":
        Path(f"{out}{suffix}").mkdir(parents=True)
    elif kind == "below a file":
        (tmp_path / "new").write_text("mine")
    elif kind == "too long":
        out = tmp_path / TOO_LONG
    else:
        if command.startswith("export"):
            write_grasps(grasps, GRASPS * 50, {"gripper": "panda"})
        request.getfixturevalue("full_disk")
    before = sorted(tmp_path.rglob("*"))
    assert run_command(command, out, scene, grasps) == 2
    error = capsys.readouterr().err
    assert f"{out}{suffix}" in error
    assert "Traceback" not in error
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.slow
def test_nothing_is_written_over_what_was_read(
    tmp_path: Path, scene: Path, grasps: Path, capsys: pytest.CaptureFixture[str]
):
    own = tmp_path / "own.json"
    bundled = Path(cli.__file__).parent / "grippers" / "panda.json"
    own.write_text(bundled.read_text())
    (tmp_path / "link.json").symlink_to(grasps)
    board = tmp_path / "board.png"
    board.write_text('{"kind": "charuco"}')
    before = tree(tmp_path)
    photo = scene / "images" / "0.png"
    for arguments in (
        ["doctor", scene, "--report", scene / "scene.json"],
        ["doctor", scene / "scene.json", "--report", scene / "scene.json"],
        ["doctor", scene, "--report", photo],
        ["export", grasps, "--out", grasps],
        ["export", grasps.parent, "--out", grasps],
        ["export", grasps, "--out", tmp_path / "link.json"],
        ["export", grasps, "--out", tmp_path / "scene" / ".." / "prediction" / "grasps.json"],
        ["export", grasps, "--gripper", own, "--out", own],
        ["figure", "features", "--scene", scene, "--out", photo],
        ["view", scene, "--screenshot", photo],
        ["view", scene, "--screenshot", scene / "scene.json"],
        ["figure", "features", "--scene", scene / "scene.json", "--out", photo],
        ["board", "--board", board, "--out", board],
    ):
        assert cli.main(list(map(str, arguments))) == 2, arguments
        assert "Traceback" not in capsys.readouterr().err
        assert tree(tmp_path) == before, arguments


@pytest.mark.slow
@pytest.mark.parametrize("name", ["overlay.png", "surface.png", "slice.png"])
def test_a_prediction_spares_photos_of_its_files_names(
    name: str, tmp_path: Path, scene: Path, detector: FlatTable, capsys: pytest.CaptureFixture[str]
):
    (scene / "images" / "0.png").rename(scene / "images" / name)
    text = (scene / "scene.json").read_text().replace("images/0.png", f"images/{name}")
    (scene / "scene.json").write_text(text)
    before = tree(tmp_path)
    assert cli.main(["predict", str(scene), "--out", str(scene / "images")]) == 2
    assert f"images/{name}: is read by this command" in capsys.readouterr().err
    assert (tree(tmp_path), detector.asked) == (before, 0)
    for _ in range(2):
        assert cli.main(["predict", str(scene), "--out", str(scene / "out")]) == 0


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.0), (1e4, -2e3, 5.0), (500_000.0, 5_400_000.0, 300.0)])
def test_a_surface_far_from_the_origin_keeps_its_millimetres(tmp_path: Path, place: tuple[float, ...]):
    """World coordinates of a map (UTM) are millions of metres; half a metre may not become two."""
    trimesh = pytest.importorskip("trimesh")
    rng = np.random.default_rng(0)
    vertices = rng.uniform(0, 0.3, (200, 3)) + place
    faces = rng.integers(0, 200, (100, 3)).astype(np.int32)
    write_surface(tmp_path / "surface.ply", Surface(vertices, faces))
    mesh = trimesh.load(tmp_path / "surface.ply", process=False)
    np.testing.assert_allclose(mesh.vertices, vertices, rtol=0, atol=1e-8)
    np.testing.assert_array_equal(mesh.faces, faces)


def program(*arguments: object, **environment: str) -> subprocess.CompletedProcess[bytes]:
    code = "import sys\nfrom neugrasp.cli import main\nsys.exit(main())"
    command = [sys.executable, "-c", code, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, check=False, env={**os.environ, **environment})


@pytest.mark.slow
def test_a_terminal_that_knows_ascii_only_is_told_the_rest_spelt_out(tmp_path: Path, grasps: Path):
    out = tmp_path / "höhe\N{SNOWMAN}.csv"
    ended = program("export", grasps, "--format", "vgn", "--out", out, PYTHONIOENCODING="ascii")
    assert ended.returncode == 0
    assert b"h\\xf6he\\u2603.csv" in ended.stdout
    assert b"Traceback" not in ended.stderr
    assert out.exists()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["a\x1b[2Jb", "bell\x07", "del\x7f", "c1\x9b2J"])
def test_a_name_cannot_move_the_terminal(tmp_path: Path, name: str):
    ended = program("export", tmp_path / name / "grasps.json")
    assert ended.returncode == 2
    printed = ended.stderr.decode()
    assert not any((ord(c) < 32 and c != "\n") or 127 <= ord(c) < 160 for c in printed)


def test_a_mistake_of_ours_is_not_the_doctor_s_red(
    scene: Path, tmp_path: Path, detector: FlatTable, capsys: pytest.CaptureFixture[str]
):
    def fail() -> None:
        raise AssertionError("a mistake of ours")

    detector.after = fail
    assert cli.main(["predict", str(scene), "--out", str(tmp_path / "out")]) == 70
    assert "a mistake of ours" in capsys.readouterr().err


@pytest.mark.slow
def test_weights_that_lead_to_no_numbers_are_named(
    scene: Path,
    tmp_path: Path,
    detector: FlatTable,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
):
    """Finite weights may be so large that the grid of distances is not."""
    grid = np.full((40, 40, 40), np.nan, np.float32)
    nowhere = Detection(Grasps.of(()), Workspace(), detector.gripper, grid)
    monkeypatch.setattr(detector, "detect", lambda _views: nowhere)
    assert cli.main(["predict", str(scene), "--out", str(tmp_path / "out")]) == 2
    assert "contains NaN or infinity; the weights are damaged" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "error", [MemoryError(), RuntimeError("DefaultCPUAllocator: can't allocate memory: you tried 9 bytes")]
)
def test_too_little_memory_is_said_in_one_line(
    error: Exception, scene: Path, tmp_path: Path, detector: FlatTable, capsys: pytest.CaptureFixture[str]
):
    def fail() -> None:
        raise error

    detector.after = fail
    assert cli.main(["predict", str(scene), "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.endswith("neugrasp: error: out of memory\n")
    assert not (tmp_path / "out").exists()


def interrupted(seconds: float, code: str, *words: str) -> tuple[int, bytes]:
    """What Python code returns, and says on stderr, that is interrupted so long after its first line."""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    # A shell that starts the tests in the background tells them, and what they start, to ignore Ctrl-C.
    heeds = partial(signal.signal, signal.SIGINT, signal.SIG_DFL)
    with subprocess.Popen([sys.executable, "-c", code, *words], preexec_fn=heeds, **pipes) as process:
        process.stdout.readline()
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        try:
            _, said = process.communicate(timeout=60)
        finally:
            process.kill()
    return process.returncode, said


INTERRUPTED = """
import sys, time, types

class Beginning:
    def find_spec(self, name, *_):
        if name == "neugrasp.cli":
            print(flush=True)

sys.meta_path.insert(0, Beginning())
sys.modules["neugrasp.evaluation.compare"] = types.SimpleNamespace(run=lambda _: time.sleep(600))
from neugrasp.__main__ import main
sys.argv[1:] = ["compare", "/nowhere", "/no"]
sys.exit(main())
"""
"""The program with a command that lasts until it is interrupted; a line when its imports begin."""


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [0, 0.05, 0.15, 0.3, 0.5, 0.8, 1.2, 3])
def test_an_interruption_in_the_first_second_leaves_no_traceback(seconds: float):
    returned, said = interrupted(seconds, INTERRUPTED)
    assert b"Traceback" not in said
    assert returned == 130


DROPPED = """
import sys, time, types, weakref
from neugrasp.__main__ import main

class Thing:
    pass

def end(_=None):
    print(flush=True)
    time.sleep(60)

def run(_):
    thing = Thing()
    watched = weakref.ref(thing, end)
    if where == "finaliser":
        watched, Thing.__del__ = None, end
    del thing
    time.sleep(600)

where = sys.argv[1]
sys.modules["neugrasp.evaluation.compare"] = types.SimpleNamespace(run=run)
sys.argv[1:] = ["compare", "/nowhere", "/no"]
sys.exit(main())
"""
"""The program while Python runs what it drops interruptions of; a line when it is there."""


@pytest.mark.parametrize("where", ["finaliser", "callback"])
def test_an_interruption_is_heeded_where_python_drops_it(where: str):
    returned, said = interrupted(0, DROPPED, where)
    assert said.endswith(b"neugrasp: interrupted\n")
    assert b"ignored" not in said
    assert returned == 130


@pytest.mark.slow
def test_the_package_loads_where_there_are_no_file_locks():
    """Windows has no fcntl."""
    code = (
        "import sys, importlib.util\n"
        "find = importlib.util.find_spec\n"
        "importlib.util.find_spec = lambda name, *rest: None if name == 'fcntl' else find(name, *rest)\n"
        "sys.modules['fcntl'] = None\n"
        "import neugrasp.simulation.generate, neugrasp.evaluation.run, neugrasp.cli\n"
        "from neugrasp.run_folder import lock_folder\nfrom pathlib import Path\nimport tempfile\n"
        "with lock_folder(Path(tempfile.mkdtemp()), 'generate'): print('held')"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, check=False)
    assert ended.stdout == b"held\n", ended.stderr.decode()
    assert b"no locks" in ended.stderr


@pytest.mark.slow
def test_grasps_of_another_hand_are_told_apart(grasps: Path, capfd: pytest.CaptureFixture[str]):
    """The TCPs stay where they are; the word is said on stderr."""
    ended = program("export", grasps, "--gripper", "robotiq_2f85")
    assert ended.returncode == 0
    assert b"found for the gripper 'panda', not for 'robotiq_2f85'" in ended.stderr
    ended = program("export", grasps, "--gripper", "panda")
    assert ended.stderr == b"neugrasp export: writing the grasps\n"


def test_a_folder_of_a_prediction_is_exported_as_its_list(grasps: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["export", str(grasps.parent)]) == 0
    by_folder = (grasps.parent / "grasps_ros.json").read_bytes()
    assert cli.main(["export", str(grasps)]) == 0
    assert (grasps.parent / "grasps_ros.json").read_bytes() == by_folder
    assert len(json.loads(by_folder)["grasps"]) == 1
    assert cli.main(["export", str(grasps.parent.parent)]) == 2
    assert "grasps.json: missing" in capsys.readouterr().err


@pytest.mark.slow
def test_views_of_a_record_are_unchanged_by_a_prediction(scene: Path, detector: FlatTable):
    """A prediction into the folder of its own scene leaves the scene as it is."""
    before = tree(scene)
    assert cli.main(["predict", str(scene), "--out", str(scene)]) == 0
    after = tree(scene)
    assert {name: after[name] for name in before} == before
    assert set(after) - set(before) == set(FILES[:4])
