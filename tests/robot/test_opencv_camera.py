"""Cameras through OpenCV: a film through the real library, live cameras that are none, with faults."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from neugrasp.geometry.lens import Lens
from neugrasp.robot.errors import CameraFault, ConnectionLost
from neugrasp.robot.opencv_camera import OpenCvCamera

WIDTH, HEIGHT = 64, 48
LENS = Lens(np.array([[60.0, 0, 31.5], [0, 60, 23.5], [0, 0, 1]]), WIDTH, HEIGHT)


def grey(level: int, width: int = WIDTH) -> np.ndarray:
    return np.full((HEIGHT, width, 3), level, dtype=np.uint8)


@dataclass
class Live:
    """Stands for `cv2.VideoCapture` at 100 Hz."""

    draw: Callable[[int], np.ndarray | None]
    """Of the number of a frame; None: there is none any more."""
    opens: bool = True
    hangs: threading.Event = field(default_factory=threading.Event)
    released: bool = False
    number: int = 0

    def isOpened(self) -> bool:
        return self.opens

    def read(self) -> tuple[bool, np.ndarray | None]:
        while self.hangs.is_set():
            time.sleep(0.01)
        time.sleep(0.01)
        self.number += 1
        frame = self.draw(self.number)
        return frame is not None, frame

    def release(self) -> None:
        self.released = True


def test_a_photo_is_of_after_it_was_asked_for_and_in_the_order_of_rgb():
    def draw(number: int) -> np.ndarray:
        frame = grey(number % 200)
        frame[..., 0] = 250
        return frame

    source = Live(draw)
    with OpenCvCamera("", LENS, capture=source) as camera:
        time.sleep(0.3)
        asked = source.number
        photo = camera.photo(2.0)
        assert photo.shape == (HEIGHT, WIDTH, 3)
        assert photo[0, 0, 0] > asked
        assert photo[0, 0, 2] == 250
    assert source.released


@pytest.mark.slow
def test_while_something_moves_there_is_no_photo():
    source = Live(lambda number: grey(17 * number % 199))
    with OpenCvCamera("", LENS, capture=source) as camera, pytest.raises(CameraFault, match="something move"):
        camera.photo(0.5)


@pytest.mark.slow
def test_a_camera_that_is_pulled_out_is_said_to_give_no_frame():
    source = Live(lambda number: grey(90) if number < 20 else None)
    with OpenCvCamera("", LENS, capture=source) as camera:
        time.sleep(0.5)
        with pytest.raises(CameraFault, match="camera 0: no frame arrives"):
            camera.photo(1.0)


@pytest.mark.slow
def test_a_driver_that_hangs_holds_nobody():
    source = Live(lambda number: grey(90))
    with OpenCvCamera("", LENS, capture=source) as camera:
        assert camera.photo(2.0).max() == 90
        source.hangs.set()
        began = time.monotonic()
        with pytest.raises(CameraFault, match="no frame arrives"):
            camera.photo(0.3)
        assert time.monotonic() - began < 2
    assert not source.released
    source.hangs.clear()


def test_another_size_than_that_of_the_cell_file_is_refused():
    source = Live(lambda number: grey(90, width=80))
    with (
        OpenCvCamera("", LENS, capture=source) as camera,
        pytest.raises(CameraFault, match="gives 80 x 48 pixels; the cell file says 64 x 48"),
    ):
        camera.photo(1.0)


def test_a_camera_that_is_not_there_is_named():
    with pytest.raises(ConnectionLost, match="camera 7: does not answer"):
        OpenCvCamera("7", LENS, capture=Live(grey, opens=False))


def test_a_film_is_read_by_the_real_library_and_ends(tmp_path: Path):
    cv2 = pytest.importorskip("cv2")
    file = tmp_path / "film.avi"
    writer = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"MJPG"), 30, (WIDTH, HEIGHT))
    for number in range(10):
        frame = grey(20 * number)
        frame[..., 2] = 200
        writer.write(frame)
    for _ in range(4):
        writer.write(frame)
    writer.release()
    with OpenCvCamera(str(file), LENS) as camera:
        photo = camera.photo(2.0)
        assert abs(int(photo[0, 0, 0]) - 200) < 12
        assert abs(int(photo[0, 0, 1]) - 180) < 12
        with pytest.raises(CameraFault, match="the film has ended"):
            camera.photo(2.0)


def test_what_is_no_film_and_no_camera_does_not_answer(tmp_path: Path):
    pytest.importorskip("cv2")
    file = tmp_path / "film.avi"
    file.write_bytes(b"no film")
    with pytest.raises(ConnectionLost, match=r"film\.avi: does not answer"):
        OpenCvCamera(str(file), LENS)
