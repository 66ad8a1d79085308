"""Where the viewer listens, and which pages it talks to."""

from __future__ import annotations

import importlib.util
import os
import socket
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from neugrasp import cli
from neugrasp.errors import InputError
from neugrasp.viewer.app import ViewerApp
from neugrasp.viewer.door import FIRST, TRIED, free_port, is_welcome
from neugrasp.viewer.scene_data import SceneData
from neugrasp.viewer.settings import Settings

from .conftest import Capture

HERE = "127.0.0.1"
needs_viser = pytest.mark.skipif(importlib.util.find_spec("viser") is None, reason="viser is not installed")


@pytest.fixture
def taken() -> Iterator[int]:
    """A port at which another program listens."""
    with socket.socket() as other:
        other.bind((HERE, 0))
        other.listen()
        yield other.getsockname()[1]


@pytest.mark.slow
@pytest.mark.parametrize("port", [-1, 65536, 99999, 2**40])
def test_what_is_no_port_ends_at_once(port: int, kept_capture: Capture, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["view", str(kept_capture.prediction), "--port", str(port)]) == 2
    assert f"--port {port}: must be from 0 to 65535" in capsys.readouterr().err


def test_a_port_in_use_ends_at_once(taken: int, kept_capture: Capture, capsys: pytest.CaptureFixture[str]):
    assert cli.main(["view", str(kept_capture.prediction), "--port", str(taken)]) == 2
    assert f"--port {taken}: is in use by another program" in capsys.readouterr().err


def test_without_a_port_the_next_free_one_is_taken():
    with socket.socket() as other:
        other.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        first = free_port(HERE, None)
        other.bind((HERE, first))
        other.listen()
        assert first < free_port(HERE, None) < FIRST + TRIED
    assert free_port(HERE, 0) == 0


def test_a_port_kept_for_the_system(monkeypatch: pytest.MonkeyPatch):
    """The superuser may listen there, so the refusal is made up."""

    class Refusing(socket.socket):
        def bind(self, _address: object) -> None:
            raise PermissionError(13, os.strerror(13))

    monkeypatch.setattr(socket, "socket", Refusing)
    with pytest.raises(InputError, match="--port 80: is kept for the system's own services"):
        free_port(HERE, 80)


@pytest.mark.parametrize("host", ["192.0.2.1", "nobody.invalid", "", "a\0b", "a" * 300])
def test_a_host_that_is_not_here(host: str):
    """192.0.2.0/24 is for examples alone."""
    with pytest.raises(InputError, match="--host"):
        free_port(host, None)


@pytest.mark.parametrize(
    ("origin", "asked", "is_let_in"),
    [
        (None, "127.0.0.1:8080", True),
        ("http://127.0.0.1:8080", "127.0.0.1:8080", True),
        ("http://localhost:9000", "localhost:9000", True),  # The port of a tunnel.
        ("http://LOCALHOST:9000", "localhost:9000", True),
        ("http://[::1]:8080", "[::1]:8080", True),
        ("http://192.168.0.7:8080", "192.168.0.7:8080", True),
        (f"http://{socket.gethostname()}:8080", f"{socket.gethostname()}:8080", True),
        ("http://evil.example", "127.0.0.1:8080", False),
        ("http://127.0.0.1:8081", "127.0.0.1:8080", False),
        ("http://localhost.evil.example:8080", "127.0.0.1:8080", False),
        # A name of another site that now leads here.
        ("http://evil.example:8080", "evil.example:8080", False),
        (None, "evil.example:8080", False),
        ("null", "127.0.0.1:8080", False),
        ("file://", "127.0.0.1:8080", False),
        ("http://127.0.0.1:8080", None, False),
        ("http://[", "[", False),
    ],
)
def test_only_pages_of_the_viewer_itself_are_welcome(origin: str | None, asked: str | None, is_let_in: bool):
    assert is_welcome(origin, asked, HERE) is is_let_in


@pytest.mark.slow
@needs_viser
@pytest.mark.filterwarnings("ignore::DeprecationWarning:websockets.*")
def test_the_server_talks_to_its_own_page_alone(data: SceneData):
    """With the subprotocol of viser's own page; whoever is let in is sent the scene."""
    import viser
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect
    from websockets.typing import Subprotocol

    with ViewerApp(data, Settings().suited_to(data), port=0) as show:
        address = show.scene.url.replace("http", "ws")
        speaks = {"subprotocols": [Subprotocol(f"viser-v{viser.__version__}")], "max_size": None}
        for origin in ("http://evil.example", "null", f"{show.scene.url}0"):
            with pytest.raises(InvalidStatus) as refused:
                connect(address, origin=origin, **speaks)
            assert refused.value.response.status_code == 403
        with connect(address, origin=show.scene.url, **speaks) as page:
            assert len(page.recv(60)) > 100
        with urllib.request.urlopen(show.scene.url, timeout=60) as page:
            assert page.status == 200


def test_the_port_is_looked_at_before_the_work(
    tmp_path: Path, taken: int, capsys: pytest.CaptureFixture[str]
):
    assert cli.main(["view", str(tmp_path), "--port", str(taken)]) == 2
    assert "is in use" in capsys.readouterr().err
