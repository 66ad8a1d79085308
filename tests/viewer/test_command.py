"""The command without a browser: what it needs, and what it says where that is missing."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from neugrasp import cli
from neugrasp.errors import InputError
from neugrasp.viewer.browser import find_browser

from .conftest import Capture


def test_without_viser_one_line_says_how_to_install_it(
    kept_capture: Capture, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.setitem(sys.modules, "viser", None)
    assert cli.main(["view", str(kept_capture.prediction)]) == 2
    assert "Run: pip install 'neugrasp[view]'" in capsys.readouterr().err


def test_what_is_nothing_to_show_ends_with_2(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["view", str(tmp_path)]) == 2
    assert "nothing to show; give a scene" in capsys.readouterr().err


def test_a_browser_that_is_not_there(monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(InputError, match="--browser /no/chromium: no such program"):
        find_browser("/no/chromium")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(InputError, match="apt install chromium"):
        find_browser()


@pytest.mark.slow
def test_contents_come_without_the_viewers_library(kept_capture: Capture):
    code = (
        "import sys\nfrom pathlib import Path\n"
        "from neugrasp.viewer.command import Viewer\nfrom neugrasp.viewer.loaders import open_scene_data\n"
        "from neugrasp.viewer.drawing import nodes_of\nfrom neugrasp.viewer.settings import Settings\n"
        f"data = open_scene_data(Viewer(Path({str(kept_capture.prediction)!r})))\n"
        "assert len(nodes_of(data, Settings().suited_to(data))) > 10\n"
        "import neugrasp.viewer.app\n"
        "assert 'viser' not in sys.modules and 'websockets' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
