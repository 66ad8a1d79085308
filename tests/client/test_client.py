"""A client hands back what the detector found, waits for a busy server, and needs no torch."""

from __future__ import annotations

import asyncio
import http.server
import importlib.util
import json
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from ball_record import ball_record
from neugrasp import cli
from neugrasp.client import AsyncClient, Client, ServerError
from neugrasp.client.client import _wait
from neugrasp.data.scene_folder import write_scene
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import USUAL
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper

if importlib.util.find_spec("httpx") is None:
    pytest.skip("httpx is not installed (pip install 'neugrasp[client]')", allow_module_level=True)

FOUND = Detection(
    Grasps.of([Grasp(np.diag([1.0, -1.0, -1.0, 1.0]), 0.04, 0.9)]),
    USUAL,
    Gripper.load("panda"),
    np.full((40, 40, 40), 0.25, dtype=np.float32),
    {"too_narrow": 3},
)
RED = {"item": "poses", "level": "red", "measured": "far off", "remedy": "Calibrate again", "views": [0]}


class Standing(http.server.ThreadingHTTPServer):
    """A server that gives the answers that it was told to, in turn, the last one again and again."""

    def __init__(self, *answers: tuple[int, object]):
        super().__init__(("127.0.0.1", 0), Handler)
        self.answers = list(answers)
        self.asked: list[tuple[str, dict[str, str], bytes]] = []
        threading.Thread(target=self.serve_forever, daemon=True).start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.server_address[1]}"


class Handler(http.server.BaseHTTPRequestHandler):
    """Takes down what is asked."""

    protocol_version = "HTTP/1.1"

    def do_POST(self) -> None:
        assert isinstance(self.server, Standing)
        body = self.rfile.read(int(self.headers["Content-Length"] or 0))
        self.server.asked.append((self.path, dict(self.headers), body))
        status, content = self.server.answers[0]
        if len(self.server.answers) > 1:
            self.server.answers.pop(0)
        text = content if isinstance(content, bytes) else json.dumps(content).encode()
        self.send_response(status)
        self.send_header("Content-Length", str(len(text)))
        if status in (429, 503):
            self.send_header("Retry-After", "0")
        self.end_headers()
        self.wfile.write(text)

    do_PUT = do_POST

    def log_message(self, *_: object) -> None:
        """Says nothing."""


def answer(**more: object) -> dict[str, object]:
    doctor = {"level": "green", "verdict": "green", "findings": []}
    found = FOUND.to_dict(with_surface=True)
    return {"request": "r1", "detection": found, "doctor": doctor, "seconds": {"queue": 0.0}, **more}


@pytest.fixture
def standing(request: pytest.FixtureRequest) -> Iterator[Standing]:
    server = Standing(*request.param)
    yield server
    server.shutdown()
    server.server_close()


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    write_scene(tmp_path / "scene", ball_record(size=64).views())
    return tmp_path / "scene"


def check_found(detection: Detection) -> None:
    np.testing.assert_allclose(detection.grasps.poses, FOUND.grasps.poses)
    np.testing.assert_array_equal(detection.grid(), FOUND.tsdf)
    assert detection.rejected == FOUND.rejected
    assert detection.gripper.name == "panda"


@pytest.mark.slow
@pytest.mark.parametrize("standing", [[(200, answer())]], indirect=True)
def test_a_scene_on_disk_and_one_in_memory_come_back_as_detections(standing: Standing, scene: Path):
    with Client(standing.url, token="a-token-of-16-or-more") as client:
        detection = client.detect(scene, Steering(top=3, approach=(0, 0, -1, 30)))
        check_found(detection)
        assert detection.source == str(scene.resolve())
        check_found(client.detect(ball_record(size=64).views()))
        check_found(client.detect_at("left", sorted((scene / "images").iterdir())))
    (path, headers, body), (_, _, memory), (at_cell, _, photos) = standing.asked
    assert path.startswith("/v1/detect?tsdf=true")
    assert headers["Authorization"] == "Bearer a-token-of-16-or-more"
    assert (scene / "images/2.png").read_bytes() in body
    assert b'{"approach": [0, 0, -1, 30], "top": 3}' in body
    assert memory.count(b"\x89PNG") == 8
    assert at_cell.startswith("/v1/cells/left/detect?")
    assert photos.count(b"\x89PNG") == 4


@pytest.mark.slow
@pytest.mark.parametrize("standing", [[(429, {}), (503, {}), (200, answer())]], indirect=True)
def test_a_busy_server_is_asked_again(standing: Standing, scene: Path):
    with Client(standing.url) as client:
        check_found(client.detect(scene))
    assert len(standing.asked) == 3


@pytest.mark.slow
@pytest.mark.parametrize("standing", [[(429, {"detail": "full"})]], indirect=True)
def test_but_not_for_ever(standing: Standing, scene: Path):
    with Client(standing.url, tries=3) as client, pytest.raises(ServerError, match="full"):
        client.detect(scene)
    assert len(standing.asked) == 3


@pytest.mark.slow
@pytest.mark.parametrize("standing", [[(503, {}), (200, answer()), (200, answer())]], indirect=True)
def test_the_same_for_who_waits_for_many_things(standing: Standing, scene: Path):
    async def both() -> list[Detection]:
        async with AsyncClient(standing.url) as client:
            at_cell = client.detect_at("left", sorted((scene / "images").iterdir()))
            return list(await asyncio.gather(client.detect(scene), at_cell))

    for detection in asyncio.run(both()):
        check_found(detection)
    assert len(standing.asked) == 3


@pytest.mark.slow
@pytest.mark.parametrize(
    ("standing", "kind", "words"),
    [
        ([(422, {"detail": "view 0: no image"})], InputError, "view 0: no image"),
        ([(422, {"detail": "red", "doctor": {"findings": [RED]}})], InputError, "far off. Calibrate again"),
        ([(401, {"detail": "send the token"})], ServerError, "send the token"),
        ([(200, b"<html>")], ServerError, "no server of NeuGrasp"),
        ([(200, {"detection": 1})], InputError, "detection"),
        ([(502, b"")], ServerError, "502"),
    ],
    indirect=["standing"],
)
def test_what_goes_wrong_is_said(standing: Standing, scene: Path, kind: type[Exception], words: str):
    with Client(standing.url) as client, pytest.raises(kind, match=words):
        client.detect(scene)


def test_nobody_is_there(scene: Path):
    with (
        Client("http://127.0.0.1:9") as client,
        pytest.raises(ServerError, match="is `neugrasp serve` running"),
    ):
        client.detect(scene)
    with pytest.raises(InputError, match="begins with http"):
        Client("127.0.0.1:8421")


def test_it_waits_as_long_as_the_server_says_and_longer_each_time_else():
    assert _wait({"retry-after": "7"}, 1) == 7
    assert _wait({"retry-after": "700"}, 1) == 30
    assert [_wait({}, tried) for tried in (1, 2, 3, 9)] == [1, 2, 4, 30]


@pytest.mark.slow
def test_it_needs_no_torch():
    code = (
        "import sys; from neugrasp.client import Client; Client('http://127.0.0.1:9').close(); "
        "sys.exit('torch' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.slow
@pytest.mark.parametrize("standing", [[(200, answer())]], indirect=True)
def test_predict_asks_a_server(standing: Standing, tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    write_scene(tmp_path / "scene", ball_record(size=256).views())
    out = tmp_path / "out"
    words = ["predict", str(tmp_path / "scene"), "--out", str(out), "--server", standing.url]
    assert cli.main(words) == 0
    assert {file.name for file in out.iterdir()} == {"grasps.json", "surface.ply", "tsdf.npz", "overlay.png"}
    assert json.loads((out / "grasps.json").read_text())["grasps"][0]["score"] == 0.9
    assert cli.main([*words, "--weights", "mine"]) == 2
    assert "--weights: what the server at" in capsys.readouterr().err
