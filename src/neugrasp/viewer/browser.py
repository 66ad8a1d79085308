"""A Chromium without a window, to take pictures of the viewer and to click in it."""

from __future__ import annotations

import base64
import io
import itertools
import json
import os
import shutil
import subprocess
import tempfile
import time
import urllib.request
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image as Picture

from neugrasp.errors import InputError, NeuGraspError, require
from neugrasp.observation import Image

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")
PATIENCE = 300.0
"""Seconds that it may take to start or to answer."""
WITHOUT_NOTICES = """
document.querySelectorAll("[class*=Notification-root]").forEach(e => { e.style.display = "none" })
"""
"""Hides viser's remark that there is no graphics card."""
LARGEST_ANSWER = 64 * 2**20


def find_browser(chosen: str | None = None) -> str:
    """The program. Raises `InputError` where there is none."""
    for name in (chosen,) if chosen else NAMES:
        if path := shutil.which(name):
            return path
    if chosen:
        raise InputError(f"--browser {chosen}: no such program")
    raise InputError(
        f"no browser found for a screenshot (looked for {', '.join(NAMES)}); install Chromium or Chrome "
        "(Debian: apt install chromium), or name one: --browser PATH"
    )


class Browser:
    """One page, open as long as the block lasts."""

    def __init__(self, url: str, program: str | None = None, size: tuple[int, int] = (1600, 1000)):
        """`size` is width and height of the window. Raises `InputError` where there is no browser."""
        self._folder = tempfile.TemporaryDirectory(prefix="neugrasp-browser-", ignore_cleanup_errors=True)
        width, height = size
        command = [
            find_browser(program),
            "--headless=new",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            # On a busy machine a frame may take long; that is no reason to end the process that draws it.
            "--disable-gpu-watchdog",
            "--disable-hang-monitor",
            "--disable-renderer-backgrounding",
            "--disable-backgrounding-occluded-windows",
            "--hide-scrollbars",
            "--no-first-run",
            "--remote-debugging-port=0",
            f"--user-data-dir={self._folder.name}",
            f"--window-size={width},{height}",
        ]
        if hasattr(os, "geteuid") and os.geteuid() == 0:
            # Chromium refuses its sandbox to the superuser; the only page it sees is ours.
            command.append("--no-sandbox")
        self._process = subprocess.Popen(
            [*command, url], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        self._numbers = itertools.count(1)
        self._size = size
        self._connection: Any = None

    def __enter__(self) -> Browser:
        return self

    def __exit__(self, *_: object) -> None:
        if self._connection is not None:
            self._connection.close()
        self._process.terminate()
        try:
            self._process.wait(10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._folder.cleanup()

    def settle(self) -> None:
        """Gives the page its size."""
        self._ask("Page.enable")

    def screenshot(self) -> Image:
        """The whole page, controls included, (height, width, 3)."""
        self._ask("Runtime.evaluate", expression=WITHOUT_NOTICES)
        answer = self._ask("Page.captureScreenshot", format="png")
        with Picture.open(io.BytesIO(base64.b64decode(answer["data"]))) as picture:
            return np.asarray(picture.convert("RGB"))

    def click(self, x: float, y: float, shift: bool = False) -> None:
        """Presses and releases the left button at a pixel of the page."""
        where = {"x": x, "y": y, "button": "left", "clickCount": 1, "modifiers": 8 if shift else 0}
        self._ask("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
        for event in ("mousePressed", "mouseReleased"):
            self._ask("Input.dispatchMouseEvent", type=event, **where)

    def evaluate(self, expression: str) -> Any:
        """The value of a JavaScript expression on the page, as plain data."""
        answer = self._ask("Runtime.evaluate", expression=expression, returnByValue=True)
        if "exceptionDetails" in answer:
            raise NeuGraspError(f"the page: {answer['exceptionDetails'].get('text')} in {expression}")
        return answer["result"].get("value")

    def choose_files(self, selector: str, files: Sequence[Path]) -> None:
        """Chooses files in an input of the page, as its dialog does."""
        document = self._ask("DOM.getDocument")["root"]["nodeId"]
        node = self._ask("DOM.querySelector", nodeId=document, selector=selector)["nodeId"]
        self._ask("DOM.setFileInputFiles", nodeId=node, files=[str(file) for file in files])

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        """The page's answer to a command of the DevTools protocol."""
        if self._connection is None:
            client = require("websockets.sync.client", extra="view")
            self._connection = client.connect(self._page(), max_size=LARGEST_ANSWER, open_timeout=PATIENCE)
            # The window's frame takes a part of the size that the program was started with.
            width, height = self._size
            shape = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
            self._ask("Emulation.setDeviceMetricsOverride", **shape)
        number = next(self._numbers)
        self._connection.send(json.dumps({"id": number, "method": method, "params": parameters}))
        try:
            while True:
                answer = json.loads(self._connection.recv(PATIENCE))
                if answer.get("id") == number:
                    break
        except TimeoutError as error:
            raise NeuGraspError(f"the browser did not answer {method} within {PATIENCE:.0f} s") from error
        if "error" in answer:
            raise NeuGraspError(f"the browser refuses {method}: {answer['error'].get('message')}")
        result: dict[str, Any] = answer["result"]
        return result

    def _page(self) -> str:
        """The address at which the page takes commands."""
        file, end = Path(self._folder.name) / "DevToolsActivePort", time.monotonic() + PATIENCE
        while time.monotonic() < end:
            if self._process.poll() is not None:
                raise NeuGraspError(f"the browser ended at once (code {self._process.returncode})")
            if file.is_file() and (lines := file.read_text(encoding="utf-8").split()):
                with urllib.request.urlopen(f"http://127.0.0.1:{lines[0]}/json", timeout=PATIENCE) as reply:
                    pages = [page for page in json.load(reply) if page["type"] == "page"]
                if pages:
                    address: str = pages[0]["webSocketDebuggerUrl"]
                    return address
            time.sleep(0.1)
        raise NeuGraspError(f"the browser does not answer within {PATIENCE:.0f} s")
