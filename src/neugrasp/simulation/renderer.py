"""Photos of simulated scenes, from a Blender process that is kept alive and restarted when it dies."""

from __future__ import annotations

import importlib.util
import json
import logging
import os
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from types import TracebackType
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from neugrasp.data.world import Cell, Scene, camera_to_dict
from neugrasp.errors import InputError, MissingExtra, NeuGraspError

log = logging.getLogger(__name__)

Photo = NDArray[np.uint8]
"""(height, width, 3), sRGB."""


START_TIMEOUT_S = 180.0
"""Blender starts in 2 s on an idle machine."""


class RenderError(NeuGraspError):
    """Blender could not make a photo, twice."""


class MeshSource(Protocol):
    """What the renderer needs of an `ObjectLibrary`."""

    def model(self, object_set: str, name: str) -> Any:
        """The object, which has `visual_mesh: Path`."""


@dataclass(frozen=True)
class RenderSettings:
    """What trades picture quality for time."""

    samples: int = 4
    """A power of two: with others the scene and its background differ visibly where nothing changed. Four
    show what changed as well as eight do, in little more than half the time."""
    denoise: str = "FAST"
    """Quality of OpenImageDenoise: FAST, BALANCED, HIGH, or OFF."""
    prefilter: str = "FAST"
    """Treatment of the denoiser's guides: NONE, FAST, ACCURATE."""
    view_transform: str = "Standard"
    """Plain sRGB, which clips highlights as a small camera does."""
    cycles: dict[str, Any] = field(default_factory=dict)
    """Further settings of Cycles by Blender's names, for measurements."""

    def __post_init__(self) -> None:
        if self.samples < 1 or self.samples.bit_count() != 1:
            raise InputError(f"--samples {self.samples}; it must be a power of two: 1, 2, 4, ...")


class _Gone(Exception):
    """The Blender process died or did not answer in time."""


class Renderer:
    """Use as a context manager. The same request gives the same photos, whatever was rendered before."""

    def __init__(self, threads: int = 2, settings: RenderSettings | None = None, timeout_s: float = 180.0):
        if importlib.util.find_spec("bpy") is None:
            raise MissingExtra("bpy", "render")
        self._settings = {"threads": threads, **asdict(settings or RenderSettings())}
        self._timeout_s = timeout_s
        self._process: subprocess.Popen[str] | None = None
        self._replies = -1
        self._pending = b""
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def __enter__(self) -> Renderer:
        self._folder = tempfile.TemporaryDirectory(prefix="neugrasp-render-")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stop()
        if self._folder is not None:
            self._folder.cleanup()
            self._folder = None

    @property
    def process_id(self) -> int | None:
        """Id of the Blender process; None before the first photo."""
        return None if self._process is None else self._process.pid

    def render(
        self, cell: Cell, scene: Scene | None, library: MeshSource, camera_indices: Sequence[int]
    ) -> list[Photo]:
        """One photo per camera index of the cell; `scene` None gives the empty table.

        Raises `InputError` for an unusable mesh and `RenderError` when Blender fails twice in a row.
        """
        assert self._folder is not None, "use Renderer in a with statement"
        request = {
            "cell": _cell_data(cell),
            "bodies": [] if scene is None else _bodies_data(scene, library),
            "cameras": list(camera_indices),
            "folder": self._folder.name,
        }
        for attempt in (1, 2):
            try:
                reply = self._ask(request)
            except _Gone as gone:
                log.warning("Blender %s (attempt %d of 2)", gone, attempt)
                reply = {"error": str(gone), "details": self._log_tail()}
            if reply.get("kind") == "InputError":
                raise InputError(reply["error"])
            if "photos" in reply:
                cameras = [cell.cameras[i] for i in camera_indices]
                return [_read(p, c.width, c.height) for p, c in zip(reply["photos"], cameras, strict=True)]
            self._stop()
        log.error("Blender failed: %s", reply["details"])
        raise RenderError(f"Blender could not render cell {cell.seed}: {reply['error']}")

    def _ask(self, request: dict[str, Any]) -> dict[str, Any]:
        if self._process is None or self._process.poll() is not None:
            self._start()
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
        except OSError as error:
            raise _Gone("died") from error
        return self._reply(self._timeout_s)

    def _start(self) -> None:
        assert self._folder is not None
        self._stop()
        receiving, sending = os.pipe()
        command = [
            sys.executable,
            "-m",
            "neugrasp.simulation.blender",
            json.dumps(self._settings),
            str(sending),
        ]
        with Path(self._folder.name, "blender.log").open("w", encoding="utf-8") as output:
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=output, stderr=output, pass_fds=(sending,), text=True
            )
        os.close(sending)
        self._replies, self._pending = receiving, b""
        self._reply(START_TIMEOUT_S)

    def _reply(self, timeout_s: float) -> dict[str, Any]:
        """The next line of the reply pipe, decoded. Raises `_Gone` on its end or on a time-out."""
        deadline = time.monotonic() + timeout_s
        while b"\n" not in self._pending:
            ready, _, _ = select.select([self._replies], [], [], max(0.0, deadline - time.monotonic()))
            if not ready:
                raise _Gone(f"did not answer within {timeout_s:.0f} s")
            chunk = os.read(self._replies, 1 << 16)
            if not chunk:
                raise _Gone("died")
            self._pending += chunk
        line, self._pending = self._pending.split(b"\n", 1)
        reply: dict[str, Any] = json.loads(line)
        return reply

    def _stop(self) -> None:
        if self._process is None:
            return
        self._process.kill()
        self._process.communicate()
        self._process = None
        os.close(self._replies)

    def _log_tail(self) -> str:
        assert self._folder is not None
        path = Path(self._folder.name, "blender.log")
        return path.read_text(encoding="utf-8", errors="replace")[-2000:] if path.exists() else ""


def _cell_data(cell: Cell) -> dict[str, Any]:
    return {
        "seed": cell.seed,
        "cameras": [camera_to_dict(camera) for camera in cell.cameras],
        "light": cell.light,
        "table": cell.table,
    }


def _bodies_data(scene: Scene, library: MeshSource) -> list[dict[str, Any]]:
    return [
        {
            "mesh": str(library.model(body.object_set, body.name).visual_mesh),
            "scale": body.scale,
            "position": list(body.position),
            "quaternion_xyzw": list(body.quaternion_xyzw),
            "parameters": material.parameters,
        }
        for body, material in zip(scene.bodies, scene.materials, strict=True)
    ]


def _read(photo: dict[str, Any], width: int, height: int) -> Photo:
    """The rendered part, its edge repeated over what lies outside the sensor."""
    left, top, right, bottom = photo["border"]
    margin = photo["margin"]
    rendered = np.asarray(Image.open(photo["file"]).convert("RGB"))
    pixels = rendered[margin:-margin, margin:-margin]
    if pixels.shape[:2] != (bottom - top, right - left):
        raise RenderError(
            f"Blender rendered {pixels.shape[1]} x {pixels.shape[0]} pixels of {photo['border']}"
        )
    return np.pad(pixels, ((top, height - bottom), (left, width - right), (0, 0)), mode="edge")
