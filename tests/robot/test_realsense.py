"""The RealSense driver through the real library, fed with frames of ours by its software device."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from neugrasp.errors import InputError
from neugrasp.geometry.lens import Lens
from neugrasp.robot.errors import CameraFault, ConnectionLost
from neugrasp.robot.realsense import RealSense

try:
    import pyrealsense2 as rs
except ImportError:
    pytest.skip("needs neugrasp[robot] and libusb", allow_module_level=True)

WIDTH, HEIGHT = 64, 48
LENS = Lens(np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]), WIDTH, HEIGHT)
WIDE = Lens(np.array([[459.0, 0, 320], [0, 459, 180], [0, 0, 1]]), 640, 360)


@dataclass
class Feed:
    """Frames at 100 Hz, each a picture of its number and the seconds since the beginning."""

    device: Any
    sensor: Any
    profile: Any
    draw: Callable[[int], int]
    ends: threading.Event
    number: int = 0

    def run(self) -> None:
        while not self.ends.wait(0.01):
            self.number += 1
            frame = rs.software_video_frame()
            grey = self.draw(self.number)
            frame.pixels = np.full((HEIGHT, WIDTH, 3), grey, dtype=np.uint8)
            frame.bpp, frame.stride = 3, 3 * WIDTH
            frame.timestamp, frame.frame_number = 10.0 * self.number, self.number
            frame.domain = rs.timestamp_domain.hardware_clock
            frame.profile = self.profile
            self.sensor.on_video_frame(frame)


@pytest.fixture
def feed() -> Iterator[Callable[..., Feed]]:
    ends, threads = threading.Event(), []

    def feeding(draw: Callable[[int], int], fx: float = 0.0, k1: float = 0.0) -> Feed:
        device = rs.software_device()
        sensor = device.add_sensor("Color")
        stream = rs.video_stream()
        stream.type, stream.fmt, stream.index, stream.uid = rs.stream.color, rs.format.rgb8, 0, 1
        stream.width, stream.height, stream.fps, stream.bpp = WIDTH, HEIGHT, 30, 3
        said = rs.intrinsics()
        said.width, said.height = WIDTH, HEIGHT
        said.fx, said.fy, said.coeffs = fx, fx, [k1, 0.0, 0.0, 0.0, 0.0]
        stream.intrinsics = said
        profile = rs.video_stream_profile(sensor.add_video_stream(stream))
        feed = Feed(device, sensor, profile, draw, ends)
        thread = threading.Thread(target=feed.run)
        threads.append(thread)
        thread.start()
        return feed

    yield feeding
    ends.set()
    for thread in threads:
        thread.join()


@pytest.mark.slow
def test_a_photo_is_of_after_it_was_asked_for(feed: Callable[..., Feed]):
    source = feed(lambda number: number % 200)
    with RealSense("", LENS, device=source.device) as camera:
        time.sleep(0.3)
        asked = source.number
        photo = camera.photo(2.0)
        assert photo.shape == (HEIGHT, WIDTH, 3)
        assert photo.dtype == np.uint8
        assert photo[0, 0, 0] > asked % 200


@pytest.mark.slow
def test_while_something_moves_there_is_no_photo(feed: Callable[..., Feed]):
    source = feed(lambda number: 100 if number % 2 else 140)
    with (
        RealSense("", LENS, device=source.device) as camera,
        pytest.raises(CameraFault, match="does something move"),
    ):
        camera.photo(0.5)


@pytest.mark.slow
def test_where_no_frame_comes_that_is_said(feed: Callable[..., Feed]):
    source = feed(lambda number: 0)
    with RealSense("", LENS, device=source.device) as camera:
        source.ends.set()
        time.sleep(0.1)
        with pytest.raises(CameraFault, match="no frame arrives"):
            camera.photo(0.3)


def test_a_size_that_is_not_offered_is_refused_with_those_that_are(
    feed: Callable[..., Feed],
):
    with pytest.raises(ConnectionLost, match="no stream of 640 x 360 at 30 Hz; there are: 64 x 48"):
        RealSense("", WIDE, device=feed(lambda number: 0).device)


def test_a_camera_that_is_not_there_is_named():
    with pytest.raises(ConnectionLost, match="RealSense 123: not connected"):
        RealSense("123", WIDE)


def test_a_camera_that_says_it_has_another_lens_is_not_believed(feed: Callable[..., Feed]):
    with pytest.raises(InputError, match=r"has distortion.*write camera\.distortion"):
        RealSense("", LENS, device=feed(lambda number: 0, k1=0.1).device)
    bent = replace(LENS, radial=(0.1, 0.0, 0.0))
    with RealSense("", bent, device=feed(lambda number: 0, fx=60.0, k1=0.1).device) as camera:
        assert camera.photo(2.0).shape == (HEIGHT, WIDTH, 3)
    with pytest.raises(InputError, match=r"says fx = 80\.0 at this size, the cell file 60\.0"):
        RealSense("", LENS, device=feed(lambda number: 0, fx=80.0).device)
