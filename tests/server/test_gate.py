"""Who is let in, how much they may bring, and what happens when there are too many, or they vanish."""

from __future__ import annotations

import json
import logging
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import httpx
import pytest

import held_detector
from neugrasp import cli

from .conftest import Running, parts_of

Start = Callable[..., Running]
WHOLE = ("scene", "image", "background")
TOKEN = "a-token-of-more-than-16-letters"


@pytest.fixture
def held() -> Iterator[None]:
    """Detections wait until `LET_GO` is set."""
    while held_detector.BEGUN.acquire(blocking=False):
        pass
    held_detector.LET_GO.clear()
    yield
    held_detector.LET_GO.set()


def until(condition: Callable[[], bool], seconds: float = 20) -> bool:
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.02)
    return condition()


def detect(running: Running, scene: Path, **headers: str) -> httpx.Response:
    return httpx.post(f"{running.url}/v1/detect", files=parts_of(scene, *WHOLE), headers=headers, timeout=60)


@pytest.mark.slow
def test_a_token_is_asked_for(start: Start, scene: Path):
    running = start(token=TOKEN)
    assert detect(running, scene).status_code == 401
    assert detect(running, scene, Authorization="Bearer wrong").status_code == 401
    assert detect(running, scene, Authorization=f"Bearer {TOKEN}").status_code == 200
    assert httpx.get(f"{running.url}/metrics").status_code == 401
    assert httpx.get(f"{running.url}/v1/weights").headers["www-authenticate"] == "Bearer"
    for path in ("/", "/healthz", "/readyz", "/docs"):
        assert httpx.get(running.url + path).status_code == 200


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        ({}, 200),
        ({"Origin": "OWN"}, 200),
        ({"Origin": "https://elsewhere.example"}, 403),
        ({"Origin": "null"}, 403),
        ({"Host": "leads.here.example"}, 403),
    ],
)
def test_pages_of_other_sites_are_not_talked_to(served: Running, headers: dict[str, str], status: int):
    own = {name: served.url if value == "OWN" else value for name, value in headers.items()}
    assert httpx.get(f"{served.url}/v1/weights", headers=own).status_code == status


@pytest.mark.slow
def test_who_has_the_token_may_come_by_any_name_but_not_from_another_page(start: Start):
    running = start(token=TOKEN)
    known = {"Authorization": f"Bearer {TOKEN}", "Host": "gpu-box.lab"}
    assert httpx.get(f"{running.url}/v1/weights", headers=known).status_code == 200
    foreign = {**known, "Origin": "https://elsewhere.example"}
    assert httpx.get(f"{running.url}/v1/weights", headers=foreign).status_code == 403


@pytest.mark.parametrize("says_length", [True, False])
def test_a_body_that_is_too_large_is_not_read(start: Start, says_length: bool):
    running = start(largest_mb=0.05)
    part = b'--edge\r\nContent-Disposition: form-data; name="scene"; filename="scene.json"\r\n\r\n'
    body = part + b"x" * 10**6
    content = body if says_length else iter([body[i : i + 10**4] for i in range(0, len(body), 10**4)])
    try:
        answer = httpx.post(f"{running.url}/v1/detect", content=content, headers={"Content-Type": MULTIPART})
    except httpx.WriteError:
        # The server hung up before it had read what it does not want.
        return
    assert answer.status_code == 413
    assert "0.05 MB" in answer.json()["detail"]


MULTIPART = "multipart/form-data; boundary=edge"


@pytest.mark.slow
def test_a_body_that_does_not_come_is_given_up(start: Start):
    running = start(patience_s=0.5)
    with socket.create_connection(("127.0.0.1", running.server.port)) as connection:
        head = (
            f"POST /v1/detect HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: {MULTIPART}\r\nContent-Length: 999"
        )
        connection.sendall(f"{head}\r\n\r\n--edge".encode())
        connection.settimeout(20)
        answer = connection.recv(4096)
    assert b" 408 " in answer.splitlines()[0]
    assert until(lambda: running.service.workers.held == 0)


def test_more_pixels_than_are_read_are_refused_before_they_are_decoded(start: Start, scene: Path):
    answer = detect(start(megapixels=0.05), scene)
    assert answer.status_code == 422
    assert "0.png: 256 x 256 pixels" in answer.json()["detail"]
    assert "at most 0.05 megapixels" in answer.json()["detail"]


@pytest.mark.slow
@pytest.mark.usefixtures("held")
def test_overload_is_answered_with_429_and_when_to_come_again(start: Start, scene: Path):
    running = start(queue=2)
    with ThreadPoolExecutor(2) as pool:
        asked = [pool.submit(detect, running, scene) for _ in range(2)]
        assert until(lambda: running.service.workers.held == 2)
        for _ in range(5):
            refused = detect(running, scene)
            assert refused.status_code == 429
            assert 1 <= int(refused.headers["retry-after"]) <= 60
        held_detector.LET_GO.set()
        assert [one.result().status_code for one in asked] == [200, 200]
    assert detect(running, scene).status_code == 200


@pytest.mark.slow
@pytest.mark.usefixtures("held")
def test_an_answer_that_takes_too_long_is_given_up(start: Start, scene: Path):
    running = start(patience_s=1.0)
    assert detect(running, scene).status_code == 504
    held_detector.LET_GO.set()
    # On a busy machine an answer may take longer than that, too.
    assert until(lambda: detect(running, scene).status_code == 200, 120)


@pytest.mark.slow
@pytest.mark.usefixtures("held")
def test_clients_that_are_killed_leave_nothing_behind(start: Start, scene: Path):
    """Neither a place in the queue, nor a file, nor a detection that nobody wants."""
    running = start(queue=4)
    request = httpx.Request("POST", f"{running.url}/v1/detect", files=parts_of(scene, *WHOLE))
    body = request.read()
    lines = [f"{name}: {value}" for name, value in request.headers.items()]
    head = "\r\n".join(["POST /v1/detect HTTP/1.1", *lines]).encode() + b"\r\n\r\n"
    before = open_files()
    for sent in (len(body), len(body), len(body), len(body) // 2):
        connection = socket.create_connection(("127.0.0.1", running.server.port))
        connection.sendall(head + body[:sent])
        if sent == len(body):
            assert until(lambda: running.service.workers.held >= 1)
        time.sleep(0.1)
        connection.close()
    assert until(lambda: running.service.workers.held == 0)
    held_detector.LET_GO.set()
    assert detect(running, scene).status_code == 200
    begun = 0
    while held_detector.BEGUN.acquire(timeout=0.2):
        begun += 1
    # The one that had begun, and the last.
    assert begun == 2
    assert until(lambda: open_files() <= before)


def open_files() -> int:
    return len(list(Path("/proc/self/fd").iterdir()))


@pytest.mark.slow
def test_no_more_cells_than_there_is_room_for(start: Start, scene: Path):
    running = start(cells=2)
    parts = parts_of(scene, "scene", "background")
    answers = [httpx.put(f"{running.url}/v1/cells/{name}", files=parts) for name in ("a", "b", "a", "c")]
    assert [answer.status_code for answer in answers] == [200, 200, 200, 409]
    assert "(a, b)" in answers[-1].json()["detail"]


@pytest.mark.slow
def test_the_log_has_one_line_for_each_request_and_no_photo(
    served: Running, scene: Path, caplog: pytest.LogCaptureFixture
):
    with caplog.at_level(logging.INFO, logger="neugrasp.server.gate"):
        answer = detect(served, scene, **{"X-Request-ID": "mine-1"})
        httpx.get(f"{served.url}/v1/cells/secret%0Aname/detect")
    assert answer.headers["x-request-id"] == answer.json()["request"] == "mine-1"
    first, second = (json.loads(record.getMessage()) for record in caplog.records)
    assert first["bytes"] > 10_000
    assert (first["request"], first["status"], first["doctor"], first["grasps"]) == (
        "mine-1",
        200,
        "green",
        2,
    )
    assert len(json.dumps(first)) < 400
    assert second["status"] in (404, 405)
    assert "secret" not in json.dumps(second)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--host", "0.0.0.0"], "clients must send a token"),
        (["--token-file", "short"], "one token of 16 to 512"),
        (["--token-file", "missing"], "missing"),
        (["--queue", "0"], "--queue 0: must be at least 1"),
        (["--port", "70000"], "--port 70000"),
        (["--detector", "oracle"], "needs truth"),
        (["--weights", "none_such"], "none_such"),
    ],
)
def test_what_cannot_be_served_is_said(
    words: list[str], reason: str, tmp_path: Path, monkeypatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    Path("short").write_text("secret", encoding="utf-8")
    assert cli.main(["serve", *words]) == 2
    assert reason in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 0), (signal.SIGINT, 130)])
def test_a_signal_drains(number: int, code: int, scene: Path, tmp_path: Path):
    """What was begun is answered, nothing new is taken, and the program ends as it should."""
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    command = [
        sys.executable,
        "-m",
        "neugrasp",
        "serve",
        "--detector",
        "slow_detector:SPEC",
        "--port",
        str(port),
    ]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([*sys.path, str(Path(__file__).parent)])}
    with subprocess.Popen(
        command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as program:
        url = f"http://127.0.0.1:{port}"
        assert until(lambda: is_ready(url), 120)
        answers: list[int] = []
        thread = threading.Thread(
            target=lambda: answers.append(detect(Running(None, url), scene).status_code)
        )
        thread.start()
        assert until(lambda: "neugrasp_held_requests 1.0" in httpx.get(f"{url}/metrics").text)
        program.send_signal(number)
        assert until(lambda: not is_ready(url))
        thread.join(60)
        out, error = program.communicate(timeout=60)
    assert answers == [200]
    assert program.returncode == code, error
    assert "Traceback" not in error
    assert ("drained: 1 detections" in out) == (code == 0)


def is_ready(url: str) -> bool:
    try:
        return httpx.get(f"{url}/readyz").status_code == 200
    except httpx.HTTPError:
        return False
