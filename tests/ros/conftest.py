"""A peer that speaks the rosbridge protocol, version 2, and what cameras say to it."""

from __future__ import annotations

import asyncio
import base64
import json
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image as Picture
from websockets.sync.server import ServerConnection, serve

from ball_record import ball_record
from held_detector import FlatTable
from neugrasp.geometry.pose import inverse, rigid, rotation_about, to_quaternion
from neugrasp.gripper import Gripper
from neugrasp.observation import Views
from neugrasp.ros.messages import header
from neugrasp.ros.node import Node
from neugrasp.ros.parameters import CameraTopics, Parameters

WORLD_FROM_WORKSPACE = rigid(rotation_about((0.2, -0.1, 1.0), 0.7), (0.5, -0.2, 0.9))
WORLD_FROM_MAST = rigid(rotation_about((1.0, 0.3, 0.1), 0.4), (0.1, 0.2, 0.3))
"""A frame between the world and the cameras."""


class Peer:
    """A rosbridge of one client: takes down what is said, and says what it is told to."""

    def __init__(self) -> None:
        self.said: list[dict[str, Any]] = []
        self.connections = 0
        self._connection: ServerConnection | None = None
        self._server = serve(self._take, "127.0.0.1", 0, max_size=2**26)
        self.url = f"ws://127.0.0.1:{self._server.socket.getsockname()[1]}"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def _take(self, connection: ServerConnection) -> None:
        self._connection, self.connections = connection, self.connections + 1
        for text in connection:
            self.said.append(json.loads(text))

    def say(self, **message: Any) -> None:
        assert self._connection is not None
        self._connection.send(json.dumps(message))

    def hang_up(self) -> None:
        assert self._connection is not None
        self._connection.close()

    def close(self) -> None:
        self._server.shutdown()

    def wait(self, op: str, count: int = 1, **fields: Any) -> dict[str, Any]:
        """The message of an operation with these fields, as soon as so many of them came."""
        end = time.monotonic() + 60
        while time.monotonic() < end:
            found = [m for m in self.said if m["op"] == op and all(m.get(k) == v for k, v in fields.items())]
            if len(found) >= count:
                return found[count - 1]
            time.sleep(0.02)
        raise AssertionError(f"no {op} with {fields}; there were {[m['op'] for m in self.said]}")


@pytest.fixture
def peer() -> Iterator[Peer]:
    one = Peer()
    yield one
    one.close()


@pytest.fixture(scope="session")
def views() -> Views:
    """The ball in a world of its own."""
    seen = ball_record(size=256).views()
    moved = tuple(replace(v, camera=v.camera.moved(WORLD_FROM_WORKSPACE)) for v in seen.frames)
    return Views(moved, replace(seen.workspace, world_from_workspace=WORLD_FROM_WORKSPACE))


@pytest.fixture
def given(views: Views, peer: Peer, tmp_path: Path) -> Parameters:
    """The first two cameras raw, the others compressed; no backgrounds yet."""
    cameras = tuple(
        CameraTopics(
            f"/camera{i}/image{'/compressed' if i > 1 else ''}", f"/camera{i}/camera_info", f"optical{i}"
        )
        for i in range(len(views))
    )
    return Parameters(cameras, views.workspace, tmp_path / "backgrounds", peer.url, world_frame="base")


@pytest.fixture
def node(given: Parameters) -> Iterator[Node]:
    """A node that runs meanwhile, with a detector that needs no weights."""
    one = Node(given, Gripper.load("panda"), FlatTable().detect)
    loop = asyncio.new_event_loop()
    task = loop.create_task(one.bridge.run())
    thread = threading.Thread(target=lambda: _until_cancelled(loop, task))
    thread.start()
    yield one
    loop.call_soon_threadsafe(task.cancel)
    thread.join(30)
    assert not thread.is_alive()


def _until_cancelled(loop: asyncio.AbstractEventLoop, task: asyncio.Task[None]) -> None:
    try:
        loop.run_until_complete(task)
    except asyncio.CancelledError:
        pass
    finally:
        loop.run_until_complete(loop.shutdown_default_executor())
        loop.close()


Show = Callable[..., None]


@pytest.fixture
def show(peer: Peer, views: Views, given: Parameters) -> Show:
    """Publishes what the cameras see now: "image" or "background"."""

    def publish(kind: str = "image", with_tf: bool = True) -> None:
        if with_tf:
            peer.say(op="publish", topic="/tf_static", msg=tree(views))
        for topics, view in zip(given.cameras, views.frames, strict=True):
            photo = getattr(view, kind)
            message = compressed(photo) if topics.is_compressed else raw(photo)
            peer.say(op="publish", topic=topics.camera_info, msg=info(view.camera.intrinsics, photo))
            peer.say(op="publish", topic=topics.image, msg=message)

    return publish


def raw(photo: np.ndarray, encoding: str = "bgr8") -> dict[str, Any]:
    """A sensor_msgs/Image with padded rows."""
    height, width = photo.shape[:2]
    pixels = {"bgr8": photo[..., ::-1], "rgb8": photo, "mono8": photo[..., :1]}[encoding]
    step = width * pixels.shape[2] + 8
    rows = np.zeros((height, step), dtype=np.uint8)
    rows[:, : step - 8] = pixels.reshape(height, -1)
    return {
        "header": header("optical"),
        "height": height,
        "width": width,
        "encoding": encoding,
        "is_bigendian": 0,
        "step": step,
        "data": base64.b64encode(rows.tobytes()).decode(),
    }


def compressed(photo: np.ndarray) -> dict[str, Any]:
    """A sensor_msgs/CompressedImage."""
    import io

    stream = io.BytesIO()
    Picture.fromarray(photo).save(stream, format="PNG")
    data = base64.b64encode(stream.getvalue()).decode()
    return {"header": header("optical"), "format": "rgb8; png compressed", "data": data}


def info(intrinsics: np.ndarray, photo: np.ndarray, **more: Any) -> dict[str, Any]:
    """A sensor_msgs/CameraInfo of a rectified photo; K is that of the raw one, and another."""
    projection = np.hstack([intrinsics, np.zeros((3, 1))])
    return {
        "header": header("optical"),
        "height": photo.shape[0],
        "width": photo.shape[1],
        "distortion_model": "plumb_bob",
        "d": [0.1, 0.0, 0.0, 0.0, 0.0],
        "k": (intrinsics * [[1.1], [1.1], [1.0]]).ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": projection.ravel().tolist(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
        **more,
    }


def tree(views: Views) -> dict[str, Any]:
    """A tf2_msgs/TFMessage: the cameras on a mast that stands in the world."""
    joints = [("base", "mast", WORLD_FROM_MAST)]
    for i, view in enumerate(views.frames):
        joints.append(("mast", f"optical{i}", inverse(WORLD_FROM_MAST) @ view.camera.world_from_camera))
    return {
        "transforms": [
            {
                "header": header(parent),
                "child_frame_id": child,
                "transform": {
                    "translation": dict(zip("xyz", pose[:3, 3].tolist(), strict=True)),
                    "rotation": dict(zip("xyzw", to_quaternion(pose).tolist(), strict=True)),
                },
            }
            for parent, child, pose in joints
        ]
    }
