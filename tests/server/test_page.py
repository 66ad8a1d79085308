"""The page in a real browser: files are chosen, and surface and grasps appear."""

from __future__ import annotations

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from browsers import no_browser
from neugrasp.viewer.browser import Browser

from .conftest import Running

PATIENCE = 120


MISSING = no_browser("websockets")

pytestmark = [
    pytest.mark.slow,
    pytest.mark.timeout(900),
    pytest.mark.skipif(bool(MISSING), reason=MISSING),
    pytest.mark.filterwarnings("ignore::DeprecationWarning:websockets.*"),
]


@pytest.fixture(scope="module")
def browser(served: Running) -> Iterator[Browser]:
    with Browser(served.url, size=(1000, 1400)) as one:
        one.settle()
        assert until(one, "document.readyState === 'complete' && !!document.getElementById('ask')")
        yield one


def until(browser: Browser, expression: str) -> bool:
    end = time.monotonic() + PATIENCE
    while not browser.evaluate(expression) and time.monotonic() < end:
        time.sleep(0.1)
    return bool(browser.evaluate(expression))


def said(browser: Browser) -> str:
    return str(browser.evaluate("document.getElementById('said').textContent"))


def files_of(scene: Path, folder: Path, *kinds: str) -> list[Path]:
    """The files of a scene side by side, as cameras write them: the same names are not twice there."""
    text = (scene / "scene.json").read_text()
    files = []
    for kind in kinds:
        for file in sorted((scene / kind).iterdir()):
            copy = folder / f"{kind}_{file.name}"
            copy.write_bytes(file.read_bytes())
            files.append(copy)
    for kind in ("images", "backgrounds"):
        text = text.replace(f"{kind}/", f"{kind}_")
    (folder / "scene.json").write_text(text)
    return [*files, folder / "scene.json"]


def test_photos_are_chosen_and_grasps_are_seen(browser: Browser, scene: Path, tmp_path: Path):
    browser.choose_files("#chosen", files_of(scene, tmp_path, "images", "backgrounds"))
    assert until(browser, "!document.getElementById('ask').disabled")
    assert said(browser) == "4 views. Ready."
    before = browser.screenshot()
    browser.evaluate("document.getElementById('ask').click()")
    assert until(browser, "document.getElementById('said').textContent === 'Done.'")
    report = str(browser.evaluate("document.getElementById('report').srcdoc"))
    assert "2 grasps for the panda gripper" in report
    time.sleep(1)
    after = browser.screenshot()
    # The report with its photos of the red ball fills the lower half.
    red = (after[..., 0] > 1.8 * after[..., 1].astype(float)).sum()
    assert red > 500
    assert np.abs(after.astype(int) - before).max(axis=-1).mean() > 5


def test_a_photo_that_is_missing_is_named(browser: Browser, scene: Path, tmp_path: Path):
    browser.choose_files("#chosen", files_of(scene, tmp_path, "images", "backgrounds")[1:])
    assert until(browser, "document.getElementById('said').className === 'bad'")
    assert "images_0.png is missing: scene.json names it" in said(browser)
    assert browser.evaluate("document.getElementById('ask').disabled") is True


def test_what_the_server_refuses_is_shown(browser: Browser, scene: Path, tmp_path: Path):
    files = files_of(scene, tmp_path, "images", "backgrounds")
    for file in tmp_path.glob("backgrounds_*"):
        file.write_bytes((tmp_path / file.name.replace("backgrounds", "images")).read_bytes())
    browser.choose_files("#chosen", files)
    assert until(browser, "!document.getElementById('ask').disabled")
    browser.evaluate("document.getElementById('ask').click()")
    assert until(browser, "document.getElementById('said').className === 'bad'")
    assert "the doctor says red" in said(browser)
    assert "red: " in said(browser)


def test_the_description_is_drawn(served: Running):
    with Browser(f"{served.url}/docs", size=(1000, 1400)) as one:
        one.settle()
        assert until(one, "document.querySelectorAll('.opblock').length >= 10")
        words = str(one.evaluate("document.body.innerText"))
    assert "/v1/cells/{cell}/detect" in words
