"""A server on a free port with a detector that needs no weights, and a scene to send."""

from __future__ import annotations

import importlib.util
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from ball_record import ball_record
from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.observation import Views
from neugrasp.server.command import Serve

NEEDED = ("fastapi", "uvicorn", "python_multipart", "prometheus_client", "fastapi_offline", "httpx")
MISSING = [name for name in NEEDED if importlib.util.find_spec(name) is None]
if MISSING:
    collect_ignore_glob = ["test_*.py"]

WORLD_FROM_WORKSPACE = rigid(rotation_about((0.2, -0.1, 1.0), 0.7), (0.5, -0.2, 0.9))
"""The user's world is not the workspace frame."""


@dataclass(frozen=True)
class Running:
    """A server, and where it is."""

    server: Any
    url: str
    token: str | None = None

    @property
    def service(self) -> Any:
        return self.server.service


@contextmanager
def running(token: str | None = None, **options: Any) -> Iterator[Running]:
    """A server of our own detector that listens meanwhile."""
    from neugrasp.server.listening import Server
    from neugrasp.server.service import Service

    config = Serve(**{"detector": "held_detector:SPEC", "patience_s": 20.0, "grace_s": 5.0, **options})
    server = Server(Service(config), 0, token)
    thread = threading.Thread(target=server.serve_until_told)
    thread.start()
    try:
        server.wait()
        yield Running(server, f"http://127.0.0.1:{server.port}", token)
    finally:
        server.should_exit = True
        thread.join(30)
        assert not thread.is_alive()


@pytest.fixture
def start() -> Iterator[Callable[..., Running]]:
    """Starts servers with options of a test's own."""
    with ExitStack() as stack:
        yield lambda **options: stack.enter_context(running(**options))


@pytest.fixture(scope="module")
def served() -> Iterator[Running]:
    """One for tests that change nothing which others see."""
    with running() as one:
        yield one


@pytest.fixture(scope="session")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A capture that the doctor calls green, in a world of its own."""
    folder = tmp_path_factory.mktemp("capture") / "scene"
    views = ball_record(size=256).views()
    moved = tuple(replace(v, camera=v.camera.moved(WORLD_FROM_WORKSPACE)) for v in views.frames)
    write_scene(folder, Views(moved, replace(views.workspace, world_from_workspace=WORLD_FROM_WORKSPACE)))
    return folder


@pytest.fixture(scope="session")
def views(scene: Path) -> Views:
    return read_scene(scene)


Part = tuple[str, tuple[str, bytes]]


def parts_of(scene: Path, *kinds: str) -> list[Part]:
    """The parts of a request, in order: "scene", "image", "background"."""
    parts: list[Part] = []
    for kind in kinds:
        if kind == "scene":
            parts.append(("scene", ("scene.json", (scene / "scene.json").read_bytes())))
        else:
            files = sorted((scene / f"{kind}s").iterdir())
            parts += [(kind, (file.name, file.read_bytes())) for file in files]
    return parts
