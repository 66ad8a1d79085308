"""What the README and the documentation promise is so."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from neugrasp.cli import COMMANDS, main
from neugrasp.data.scene_folder import read_scene
from neugrasp.detection.explanation import WORDS
from neugrasp.training.config import TrainConfig

ROOT = Path(__file__).parent.parent
README = (ROOT / "README.md").read_text()
DOCUMENTS = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md"))]


def fences(text: str, language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", text, flags=re.DOTALL | re.MULTILINE)


def test_the_first_commands_come_early():
    assert README.splitlines().index("```") < 25


@pytest.mark.slow
@pytest.mark.skipif(
    not list((ROOT / "src/neugrasp/weights").glob("*.safetensors")), reason="no weights are bundled"
)
def test_the_python_lines_of_the_readme_run(tmp_path: Path):
    (code,) = fences(README, "python")
    result = subprocess.run(
        [sys.executable, "-c", code], check=False, cwd=tmp_path, capture_output=True, text=True
    )
    assert result.returncode == 0, result.stderr


def test_every_command_that_is_named_exists():

    commands = {
        name for line in re.findall(r"^neugrasp ([\w-]+)", README, flags=re.MULTILINE) for name in [line]
    }
    assert commands
    assert commands <= set(COMMANDS)


def test_every_option_that_is_named_exists(capsys: pytest.CaptureFixture[str]):
    text = "\n".join(document.read_text() for document in DOCUMENTS).replace("\\\n", " ")
    named: dict[str, set[str]] = {}
    for command, words in re.findall(r"neugrasp ([a-z][a-z-]*)((?: [^\n`]*)?)", text):
        named.setdefault(command, set()).update(re.findall(r"(?<![\w-])--[a-z][\w.-]*", words))
    assert {"--one-object", "--approach", "--top"} <= named["predict"]
    for command, options in named.items():
        if command in COMMANDS and options:
            with pytest.raises(SystemExit):
                main([command, "--help"])
            known = set(re.findall(r"--[a-z][\w.-]*", capsys.readouterr().out))
            if command == "train":  # Every value of a recipe is an option, too.
                known |= {f"--{field.name.replace('_', '-')}" for field in fields(TrainConfig)}
            assert options <= known, f"{command}: {options - known}"


@pytest.mark.parametrize("words", ["--region 0 0 0 1 1 1", "--mask 0 m.png", "--min-height 0.02", "--top 3"])
def test_what_the_viewer_and_the_pages_say_of_steering_is_read(words: str, tmp_path: Path, capsys):
    assert main(["predict", str(tmp_path / "none"), *words.split()]) == 2
    assert "none/scene.json: missing" in capsys.readouterr().err


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_links_lead_somewhere(document: Path):
    for target in re.findall(r"\]\(([^)#]+)\)", document.read_text()):
        if not target.startswith("http"):
            assert (document.parent / target).exists(), target


@pytest.mark.parametrize("words", WORDS.values())
def test_every_reason_for_no_grasps_has_a_row_of_advice(words: str):
    assert f"| {words} |" in (ROOT / "docs/troubleshooting.md").read_text()


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_is_in_the_documentation(name: str):
    assert any(re.search(rf"neugrasp {name}\b", page.read_text()) for page in DOCUMENTS)


def test_the_first_screen_of_the_readme():
    """One sentence, one picture that the project made, two commands, ten lines of Python."""
    start = README[: README.index("## ")]
    sentence = start.split("\n\n")[1]
    assert sentence.count(". ") == 0
    (picture,) = re.findall(r"!\[[^\]]+\]\((docs/pictures/[a-z_]+\.png)\)", start)
    assert (ROOT / picture).is_file()
    assert [line.split("  ")[0] for line in fences(start, "")[0].splitlines()] == ["make demo", "make test"]
    (code,) = fences(start, "python")
    assert len(code.splitlines()) <= 10


def test_the_example_of_the_scene_format_is_a_scene(tmp_path: Path):
    (scene, _) = fences((ROOT / "docs/data_format.md").read_text(), "json")
    data = json.loads(scene)
    for key in ("image", "background"):
        file = tmp_path / data["views"][0][key]
        file.parent.mkdir()
        Picture.fromarray(np.zeros((360, 640, 3), dtype=np.uint8)).save(file)
    data["views"][0]["world_from_camera"] = nearest_rigid(data["views"][0]["world_from_camera"])
    (tmp_path / "scene.json").write_text(json.dumps(data))
    assert len(read_scene(tmp_path)) == 1


def nearest_rigid(rows: list[list[float]]) -> list[list[float]]:
    """The printed pose, which has two digits, made exact."""
    pose = np.array(rows)
    u, _, v = np.linalg.svd(pose[:3, :3])
    assert np.abs(u @ v - pose[:3, :3]).max() < 0.02
    pose[:3, :3] = u @ v
    return pose.tolist()
