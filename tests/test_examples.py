"""Every example runs as its first lines say, on something small, and leaves behind what it announces."""

from __future__ import annotations

import ast
import importlib.util
import logging
import re
import runpy
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image as Picture

from neugrasp.data.records import Record, write_record
from neugrasp.data.scene_folder import read_scene
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.training.recipes import tiny

ROOT = Path(__file__).parent.parent
EXAMPLES = sorted((ROOT / "examples").glob("*.py"))

Run = Callable[..., str]


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEUGRASP_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs the example of a number as a program in an empty folder; what it prints."""

    def program(number: str, *arguments: object) -> str:
        (file,) = (ROOT / "examples").glob(f"{number}_*.py")
        monkeypatch.setattr(sys, "argv", [str(file), *map(str, arguments)])
        monkeypatch.chdir(tmp_path)
        runpy.run_path(str(file), run_name="__main__")
        return capsys.readouterr().out

    return program


@pytest.fixture
def ball(tmp_path: Path, make_record: Callable[..., Record]) -> Path:
    """The folder of a record: a red ball on a checkered table, 128 x 128 pixels."""
    record = make_record(x=0.16, y=0.13, size=128)
    write_record(tmp_path / "records" / record.name, record)
    return tmp_path / "records" / record.name


@pytest.fixture
def weights(tmp_path: Path) -> Path:
    """A network that knows nothing."""
    torch.manual_seed(0)
    path = tmp_path / "random.safetensors"
    save_checkpoint(path, NeuGrasp(tiny().model), {})
    return path


def varied(picture: Path) -> bool:
    """Whether a picture shows anything."""
    return float(np.asarray(Picture.open(picture)).std()) > 5


@pytest.mark.parametrize("file", EXAMPLES, ids=lambda file: file.stem)
def test_it_is_short_and_begins_with_its_page(file: Path) -> None:
    text = file.read_text()
    page = ast.get_docstring(ast.parse(text)) or ""
    assert len(text.splitlines()) < 80
    assert f"python examples/{file.name}" in page


def test_they_are_numbered_without_a_gap() -> None:
    assert [file.name[:2] for file in EXAMPLES] == [f"{number:02d}" for number in range(len(EXAMPLES))]


@pytest.mark.slow
def test_hello_grasp(run: Run, ball: Path, weights: Path, tmp_path: Path) -> None:
    assert "grasps in" in run("00", "--scene", ball, "--weights", weights)
    assert varied(tmp_path / "outputs/hello/overlay.png")


@pytest.mark.slow
@pytest.mark.skipif(
    not list((ROOT / "src/neugrasp/weights").glob("*.safetensors"))
    or not list((ROOT / "src/neugrasp/demo/scenes").glob("*/scene.json")),
    reason="no weights or no scenes are bundled",
)
def test_hello_grasp_on_what_is_bundled(run: Run) -> None:
    assert "score 0." in run("00")


@pytest.mark.slow
def test_your_own_photos(run: Run, ball: Path, weights: Path, tmp_path: Path) -> None:
    assert "the scene is in" in run("01", "--source", ball, "--weights", weights)
    written, source = read_scene(tmp_path / "outputs/my_scene"), read_scene(ball)
    for view, original in zip(written.frames, source.frames, strict=True):
        assert np.array_equal(view.image, original.image)
        # The camera sees the same point of the workspace in the same pixel.
        point = source.workspace.centre
        moved = written.workspace.to_world(point)
        assert np.allclose(view.camera.project(moved)[0], original.camera.project(point)[0], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["packed", "single"])
def test_make_a_scene(run: Run, kind: str, tmp_path: Path) -> None:
    assert "rebuilt exactly" in run("02", "--kind", kind)
    assert varied(tmp_path / "outputs/scene/true_surface.png")


@pytest.mark.blender
@pytest.mark.timeout(600)
def test_render_glass(run: Run, tmp_path: Path) -> None:
    run("03", "--size", 64)
    assert varied(tmp_path / "outputs/glass/photos.png")
    for view in read_scene(tmp_path / "outputs/glass").frames:
        assert not np.array_equal(view.image, view.background)


@pytest.mark.slow
def test_train_tiny(run: Run, ball: Path, tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.WARNING)
    printed = run("04", "--data", ball.parent, "--validation", ball.parent, "--steps", 4)
    assert printed.count("  loss ") == 4
    assert "validation: L1" in printed
    assert (tmp_path / "outputs/tiny/weights.safetensors").is_file()


@pytest.mark.slow
def test_inspect_the_sdf(run: Run, ball: Path, weights: Path, tmp_path: Path) -> None:
    assert "for always +0" in run("05", "--scene", ball, "--weights", weights)
    assert varied(tmp_path / "outputs/sdf/cuts.png")
    assert varied(tmp_path / "outputs/sdf/surface.png")


@pytest.mark.slow
def test_try_a_grasp(run: Run) -> None:
    printed = run("06", "--num", 3)
    successes = int(printed.split("\nsuccess ")[1].split()[0])
    assert successes == printed.count(": success,") >= 1


@pytest.mark.slow
def test_your_own_detector(run: Run, ball: Path, tmp_path: Path) -> None:
    """Whatever the hull is, it holds the ball, and nothing far from it."""
    assert "1 grasp" in run("07", "--scene", ball)
    hull = np.load(tmp_path / "outputs/hull/tsdf.npz")["tsdf"]
    truth = np.load(ball / "truth.npz")["tsdf"]
    above = np.s_[:, :, 8:]
    assert np.all(hull[above][truth[above] < -0.3] < 0)
    assert np.count_nonzero(hull[above] < 0) < 6 * np.count_nonzero(truth[above] < 0)
    assert varied(tmp_path / "outputs/hull/overlay.png")


@pytest.mark.slow
def test_your_own_gripper(run: Run, tmp_path: Path) -> None:
    panda, wide = run("08", "--tries", 3).split("wide opens")
    assert "0 grasps" in panda
    assert "wide: success" in wide
    assert varied(tmp_path / "outputs/gripper/wide.png")


@pytest.mark.slow
def test_from_other_programs(run: Run, ball: Path, weights: Path, tmp_path: Path) -> None:
    printed = run("09", "--source", ball, "--weights", weights)
    count = int(printed.split()[0])
    assert np.load(tmp_path / "outputs/grasps.npy").shape == (count, 17)
    imported, source = read_scene(tmp_path / "outputs/imported"), read_scene(ball)
    for view, original in zip(imported.frames, source.frames, strict=True):
        assert np.array_equal(view.image, original.image)
        assert np.allclose(view.camera.world_from_camera, original.camera.world_from_camera, atol=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("fastapi") is None, reason="fastapi is not installed")
def test_ask_a_server(run: Run, ball: Path, weights: Path, tmp_path: Path) -> None:
    printed = run("11", "--scene", ball, "--weights", weights)
    assert printed.count(" grasps in ") == 2
    assert (tmp_path / "outputs/asked/surface.ply").is_file()


@pytest.mark.slow
def test_examine_a_capture(run: Run) -> None:
    poses, background = run("10").split("A background shifted")
    assert "mended: the poses are the good ones again, to 0.0e+00" in poses
    assert "red" in background
    assert re.search(r"view 0: shifted by \(-(1\.9|2\.0)\d, [-+]0\.0\d\)", background)


@pytest.mark.slow
@pytest.mark.skipif(importlib.util.find_spec("ompl") is None, reason="ompl is not installed")
def test_clear_a_table(run: Run, tmp_path: Path) -> None:
    assert "nothing was sent to arm or gripper" in run("12", "--dry-run")
    assert not (tmp_path / "outputs/cleared/rounds").exists()
    printed = run("12")
    assert "right  way through 4 views and back" in printed
    assert "of 5 objects with" in printed
    assert (tmp_path / "outputs/cleared/rounds/000000.json").is_file()
