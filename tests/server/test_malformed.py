"""Whatever is sent, the answer is one of 400 to 499 with words, and the server goes on."""

from __future__ import annotations

import io
import json
import struct
import time
import zlib
from pathlib import Path
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from .conftest import Part, Running, parts_of

EXAMPLES = 40
"""Of each of five kinds: 200 requests."""
QUICKLY = settings(
    max_examples=EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
PATHS = ("/v1/detect", "/v1/cells/any/detect", "/v1/report")
SCENE_VALUES = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=5) | st.dictionaries(st.text(max_size=12), inner, max_size=5),
    max_leaves=12,
)


def png(width: int, height: int, data: bytes) -> bytes:
    """A PNG file that says to be of a size, whatever it holds."""

    def chunk(name: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(name + content))
        return struct.pack(">I", len(content)) + name + content + check

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", data) + chunk(b"IEND", b"")


BOMBS = [
    png(50_000, 50_000, zlib.compress(bytes(10**6))),
    png(2**31 - 1, 2**31 - 1, b""),
    png(256, 256, zlib.compress(bytes(10**7))[:200]),
    b"GIF89a" + bytes(100),
    b"II*\x00\x08\x00\x00\x00" + b"\xff" * 300,
    b"RIFF\xff\xff\xff\xffWEBPVP8 ",
    b"BM" + b"\xff" * 60,
    b"%!PS-Adobe-3.0 EPSF-3.0\n",
    b"",
]
PHOTOS = st.sampled_from(BOMBS) | st.binary(max_size=200)


@pytest.fixture(scope="module")
def client(served: Running):
    with httpx.Client(base_url=served.url, timeout=60) as one:
        yield one


def check(answer: httpx.Response) -> None:
    assert 400 <= answer.status_code < 500, answer.text
    problem = answer.json()
    assert problem["status"] == answer.status_code
    assert problem["detail"]
    assert "/tmp" not in problem["detail"]


@pytest.mark.slow
@QUICKLY
@given(
    path=st.sampled_from(PATHS),
    parts=st.lists(
        st.tuples(
            st.sampled_from(["scene", "image", "background", "mask", "steering", "x"]) | st.text(max_size=8),
            st.text(max_size=20),
            PHOTOS,
        ),
        max_size=9,
    ),
)
def test_any_parts(client: httpx.Client, path: str, parts: list[tuple[str, str, bytes]]):
    check(client.post(path, files=[(name or "n", (file, data)) for name, file, data in parts]))


@pytest.mark.slow
@QUICKLY
@given(
    path=st.sampled_from(PATHS),
    kind=st.sampled_from(
        ["multipart/form-data; boundary=edge", "multipart/form-data", "application/json", "text/plain", ""]
    ),
    body=st.binary(max_size=400)
    | st.lists(
        st.sampled_from(
            [
                b"--edge\r\n",
                b"--edge--\r\n",
                b'Content-Disposition: form-data; name="scene"; filename="a"\r\n',
                b'Content-Disposition: form-data; name="image"\r\n',
                b"Content-Disposition: form-data\r\n",
                b"Content-Type: \xff\xfe\r\n",
                b"\r\n",
                b"{}",
                b"\x00" * 40,
            ]
        ),
        max_size=14,
    ).map(b"".join),
)
def test_any_bytes(client: httpx.Client, path: str, kind: str, body: bytes):
    check(client.post(path, content=body, headers={"Content-Type": kind} if kind else {}))


@pytest.mark.slow
@QUICKLY
@given(data=st.data())
def test_any_scene(client: httpx.Client, scene: Path, data: st.DataObject):
    """A good request with something in its scene.json exchanged."""
    document = json.loads((scene / "scene.json").read_text())
    spoilt = data.draw(st.sampled_from(["all", "workspace", "views", "view", "version", "format"]))
    value = data.draw(SCENE_VALUES)
    if spoilt == "all":
        document = value
    elif spoilt == "view":
        key = data.draw(st.sampled_from(["intrinsics", "world_from_camera", "sensed"]))
        document["views"][0][key] = value if value is not None else "none"
    else:
        document[spoilt] = value
    if spoilt == "version" and value == 1:
        return
    parts: list[Part] = [("scene", ("scene.json", json.dumps(document).encode()))]
    check(client.post("/v1/detect", files=[*parts, *parts_of(scene, "image", "background")]))


@pytest.mark.slow
@QUICKLY
@given(photo=PHOTOS, number=st.integers(1, 8))
def test_any_photo(client: httpx.Client, scene: Path, photo: bytes, number: int):
    parts = parts_of(scene, "scene", "image", "background")
    parts[number] = (parts[number][0], ("0.png", photo))
    check(client.post("/v1/detect", files=parts))


@pytest.mark.slow
@QUICKLY
@given(
    steering=st.text(max_size=40)
    | st.dictionaries(
        st.sampled_from(["region", "approach", "min_height", "one_object", "top", "mask_view", "x"]),
        st.none() | st.text(max_size=4) | st.lists(st.floats(), max_size=7),
        min_size=1,
    ).map(json.dumps)
)
def test_any_steering(client: httpx.Client, scene: Path, steering: str):
    data: dict[str, Any] = {"steering": steering}
    answer = client.post("/v1/detect", files=parts_of(scene, "scene", "image", "background"), data=data)
    if answer.status_code == 200:
        # An empty wish, or numbers that happen to be a region or a side.
        assert steering.strip() in ("", "{}") or {"region", "approach"} & set(json.loads(steering))
    else:
        check(answer)


@pytest.mark.parametrize(
    "query", ["surface=stl", "tsdf=perhaps", "force=2", "surface=" + "x" * 3000, "tsdf=%ff%00"]
)
def test_any_query(client: httpx.Client, scene: Path, query: str):
    check(client.post(f"/v1/detect?{query}", files=parts_of(scene, "scene", "image", "background")))


@pytest.mark.parametrize("name", ["a b", "..", "%2e%2e%2fetc", "x" * 65, "%00", "ü"])
def test_any_name_of_a_cell(client: httpx.Client, scene: Path, name: str):
    check(client.put(f"/v1/cells/{name}", files=parts_of(scene, "scene", "background")))


def test_deep_and_long_json(client: httpx.Client, scene: Path):
    photos = parts_of(scene, "image", "background")
    for text in (b"[" * 10**5, b'{"a":' * 10**5, b'{"format": ' + b"9" * 10**5 + b"}", b"\xff\xfe{}"):
        check(client.post("/v1/detect", files=[("scene", ("scene.json", text)), *photos]))


def test_many_parts(client: httpx.Client):
    check(client.post("/v1/detect", files=[("image", ("0.png", b"x")) for _ in range(2000)]))


def test_the_server_goes_on(client: httpx.Client, scene: Path, served: Running):
    """After all of that; it comes last in this file."""
    answer = client.post("/v1/detect", files=parts_of(scene, "scene", "image", "background"))
    assert answer.status_code == 200
    # The place is given back after the answer has left.
    given_up = time.monotonic() + 10
    while served.service.workers.held and time.monotonic() < given_up:
        time.sleep(0.01)
    assert served.service.workers.held == 0
    assert "neugrasp_requests_total" in client.get("/metrics").text
    assert 'status="500"' not in client.get("/metrics").text


@pytest.mark.slow
def test_photos_as_png_and_jpeg(client: httpx.Client, scene: Path):
    """What is not malformed: the same photos in another format."""
    from PIL import Image as Picture

    parts = parts_of(scene, "scene")
    for kind in ("image", "background"):
        for file in sorted((scene / f"{kind}s").iterdir()):
            stream = io.BytesIO()
            Picture.open(file).save(stream, format="JPEG", quality=95)
            parts.append((kind, (f"{file.stem}.jpg", stream.getvalue())))
    assert client.post("/v1/detect", files=parts).status_code == 200
