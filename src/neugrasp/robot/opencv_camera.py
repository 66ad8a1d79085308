"""Any camera that OpenCV reads, by number, address or file: webcams, streams, recorded films.

Exposure and white balance are fixed where the driver lets them be; where it does not, that is said.
"""

from __future__ import annotations

import logging
import threading
import time
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from neugrasp.errors import require
from neugrasp.geometry.lens import Lens
from neugrasp.observation import Image
from neugrasp.robot.errors import CameraFault, ConnectionLost
from neugrasp.robot.still_photo import still_photo

log = logging.getLogger(__name__)

MANUAL_EXPOSURE = 1
"""Value of CAP_PROP_AUTO_EXPOSURE, as Video4Linux counts: 1 is manual, 3 automatic."""
EXPOSURE_UNIT_US = 100
"""Microseconds of one step of CAP_PROP_EXPOSURE there."""
POLL_S = 0.2


class OpenCvCamera:
    """A camera by its number, the address of a stream, or a film; number 0 where `address` is empty.

    A live camera is read all the time by a thread of its own, so that no frame grows old in the queue of its
    driver and a camera that hangs cannot hold the arm's program.
    """

    def __init__(self, address: str, lens: Lens, exposure_us: int | None = None, capture: Any = None):
        """Raises `ConnectionLost` where nothing answers, `MissingExtra` without OpenCV. `capture` is for
        tests: what stands for `cv2.VideoCapture`."""
        self._name, self._size = f"camera {address or '0'}", (lens.height, lens.width)
        self._is_film = Path(address).is_file()
        self._capture: Any = capture or _opened(address, lens, exposure_us, self._is_film)
        if not self._capture.isOpened():
            self._capture.release()
            raise ConnectionLost(f"{self._name}: does not answer; is it plugged in, and the address right?")
        self._news = threading.Condition()
        self._frame: Any = None
        self._number = 0
        self._ends = threading.Event()
        self._reader = threading.Thread(target=self._read, daemon=True)
        if not self._is_film:
            self._reader.start()

    def __enter__(self) -> OpenCvCamera:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._ends.set()
        if not self._is_film:
            self._reader.join(POLL_S)
        # A reader that hangs in the driver keeps the camera: to release it there could crash.
        if not self._reader.is_alive():
            self._capture.release()

    def photo(self, timeout_s: float) -> Image:
        """What is seen from now on, RGB (height, width, 3). Raises `CameraFault` where no frame comes, none
        is still, or the size is another."""
        last = [self._number]

        def frame(deadline: float) -> Image:
            return self._from_film() if self._is_film else self._next(last, deadline)

        return still_photo(self._name, frame, timeout_s)

    def _next(self, last: list[int], deadline: float) -> Image:
        """The first frame after number `last[0]`, which becomes its number."""
        with self._news:
            while self._number <= last[0]:
                left = deadline - time.monotonic()
                if left <= 0 or self._ends.is_set():
                    raise CameraFault(f"{self._name}: no frame arrives")
                self._news.wait(min(left, POLL_S))
            last[0] = self._number
            return self._checked(self._frame)

    def _from_film(self) -> Image:
        is_there, frame = self._capture.read()
        if not is_there:
            raise CameraFault(f"{self._name}: no frame arrives: the film has ended")
        return self._checked(frame)

    def _read(self) -> None:
        """The life of the reader: until the camera is left, or gives no frame any more."""
        while not self._ends.is_set():
            is_there, frame = self._capture.read()
            if not is_there:
                self._ends.set()
                return
            with self._news:
                self._frame, self._number = frame, self._number + 1
                self._news.notify_all()

    def _checked(self, frame: Any) -> Image:
        """RGB of what OpenCV gives as BGR."""
        if frame.ndim != 3 or frame.shape[2] != 3 or frame.shape[:2] != self._size:
            height, width = frame.shape[:2]
            raise CameraFault(
                f"{self._name}: gives {width} x {height} pixels; the cell file says {self._size[1]} x "
                f"{self._size[0]}"
            )
        return np.ascontiguousarray(frame[..., ::-1])


def _opened(address: str, lens: Lens, exposure_us: int | None, is_film: bool) -> Any:
    cv2: Any = require("cv2", extra="capture")
    capture = cv2.VideoCapture(int(address) if address.isdigit() else (address or 0))
    if is_film or not capture.isOpened():
        return capture
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, lens.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, lens.height)
    fixed = {
        "exposure": (cv2.CAP_PROP_AUTO_EXPOSURE, MANUAL_EXPOSURE),
        "white balance": (cv2.CAP_PROP_AUTO_WB, 0),
    }
    refused = [name for name, setting in fixed.items() if not capture.set(*setting)]
    if exposure_us is not None and not capture.set(cv2.CAP_PROP_EXPOSURE, exposure_us / EXPOSURE_UNIT_US):
        refused.append("exposure_us")
    if refused:
        log.warning(
            "camera %s: its driver does not let us fix %s; photos and backgrounds may differ in brightness",
            address or "0",
            " and ".join(refused),
        )
    return capture
