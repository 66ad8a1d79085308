"""A walk through every command: a line at once, and at the end what to do next, as it can be typed."""

from __future__ import annotations

import importlib.util
import json
import shlex
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import tyro

from ball_lessons import write_lessons
from ball_record import ball_record
from board_capture import write_board_photos
from neugrasp import cli
from neugrasp.data.records import read_record, write_record
from neugrasp.demo.bundled import demo_scenes
from neugrasp.errors import NeuGraspError
from neugrasp.viewer.browser import find_browser

SCENE = Path(str(demo_scenes()[0].folder))
CELL = Path(__file__).parents[1] / "examples/cells/twin.toml"
STEPS = {
    "demo": "demo --out demo",
    "doctor": f"doctor {SCENE}",
    "predict": f"predict {SCENE} --out out --report",
    "export": "export out",
    "view": "view out --screenshot view.png --size 320 200",
    "serve": "serve --check",
    "ros": "ros node.json --write",
    "board": "board --out board.pdf",
    "import": "import nerfstudio phone --alignment phone/alignment.json --out scene",
    "generate": "generate --no-photos --num 2 --workers 1 --out data",
    "pack": "pack --data data --out shards",
    "train": "train --recipe head-only --data shards --steps 1 --loaders 0 --out run",
    "train-evaluator": "train-evaluator --data lessons --steps 1 --out judge",
    "one-shot": "one-shot --data photos --out held",
    "evaluate": "evaluate --detector oracle --scene packed --rounds 1 --workers 1 --out rounds",
    "cell": f"cell check {CELL}",
    "capture": f"capture {CELL} --out captured",
    "calibrate": "calibrate board_photos/robot.json",
    "collect": "collect --scenes 1 --grasps 1 --samples 1 --out collected",
    "run": f"run {CELL} --detector oracle --out cleared",
    "compare": "compare rounds rounds2",
    "failures": "failures rounds",
    "inspect-episode": "inspect-episode rounds 0 --photos no",
    "table": "table packed --detectors oracle --strategies top --rounds 1 --workers 1 --out table",
    "figure": "figure trajectory --out figure.png",
    "bench": "bench --part inference --rounds 1 --threads 1 --json speed.json",
}


def test_every_command_says_at_once_what_it_does():
    assert set(STEPS) == set(cli.COMMANDS)
    for name, command in cli.COMMANDS.items():
        words = str(getattr(command.options, "doing", "")) or name
        assert words[0].islower()
        assert not words.endswith(".")


def check_typed(line: str) -> None:
    """What is to be typed next is a command with options that it knows."""
    program, name, *words = shlex.split(line.removeprefix("next: "), comments=True)
    assert program == "neugrasp"
    assert tyro.cli(cli.COMMANDS[name].options, args=words).doing


def run(words: str, folder: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-m", "neugrasp", *shlex.split(words)], cwd=folder, capture_output=True, text=True
    )
    assert ended.returncode == 0, ended.stderr
    name = shlex.split(words)[0]
    assert ended.stderr.splitlines()[0].startswith(f"neugrasp {name}: ")
    then = [line for line in ended.stdout.splitlines() if line.startswith("next: ")]
    assert then
    assert ended.stdout.splitlines()[-1] == then[-1]
    for line in then:
        if line.startswith("next: neugrasp"):
            check_typed(line)
        else:
            page, *_ = line.removeprefix("next: ").replace(",", " ").split()
            assert (Path(__file__).parents[1] / page).is_file(), line


def phone(folder: Path) -> None:
    """The bundled scene as a capture of nerfstudio."""
    shutil.copytree(SCENE, folder)
    scene = json.loads((folder / "scene.json").read_text())
    frames = []
    for view in scene["views"]:
        (fx, _, cx), (_, fy, cy), _ = view["intrinsics"]
        pose = [[row[0], -row[1], -row[2], row[3]] for row in view["world_from_camera"]]
        lens = {"fl_x": fx, "fl_y": fy, "cx": cx + 0.5, "cy": cy + 0.5, "w": 256, "h": 256}
        frames.append({"file_path": view["image"], "transform_matrix": pose, **lens})
    (folder / "transforms.json").write_text(json.dumps({"frames": frames}))
    place = {"world_from_workspace": scene["workspace"]["world_from_workspace"]}
    (folder / "alignment.json").write_text(json.dumps(place))
    (folder / "scene.json").unlink()


def photograph(data: Path, out: Path) -> None:
    """The generated scenes with photos, of something else: there is no Blender here."""
    for folder in (data / "scenes").iterdir():
        record = read_record(folder)
        seen = replace(
            ball_record(size=64),
            name=record.name,
            scene=record.scene,
            tsdf=record.tsdf,
            observed=record.observed,
        )
        write_record(out / "scenes" / record.name, seen)


@pytest.mark.slow
@pytest.mark.timeout(1800)
def test_a_walk_through_every_command(tmp_path: Path):
    phone(tmp_path / "phone")
    write_lessons(tmp_path / "lessons", 12)
    (tmp_path / "board_photos").mkdir()
    write_board_photos(tmp_path / "board_photos")
    left = dict(STEPS)
    if importlib.util.find_spec("bpy") is None:
        left.pop("capture")
        left.pop("collect")
    try:
        find_browser()
        importlib.import_module("viser")
    except (NeuGraspError, ImportError):
        left.pop("view")
    try:
        importlib.import_module("neugrasp.server.listening")
    except ImportError:
        left.pop("serve")
    for name, words in left.items():
        if name == "compare":
            shutil.copytree(tmp_path / "rounds", tmp_path / "rounds2")
        if name == "one-shot":
            photograph(tmp_path / "data", tmp_path / "photos")
        run(words, tmp_path)
