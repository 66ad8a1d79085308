"""A photo that can be believed, of whatever camera: taken after it was asked for, and of what stands still.

Two frames in a row must show the same: frames still in flight show the way here, and whatever moves is
blurred.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np

from neugrasp.observation import Image
from neugrasp.robot.errors import CameraFault

IN_FLIGHT = 4
"""Frames that may have been taken before a photo was asked for."""
FRAME_S = 0.5
"""Seconds within which a frame follows another."""
STILL = 6.0
"""Mean absolute difference of two frames of 0 to 255, from which something moves; noise is 1 to 3."""


def still_photo(name: str, frame: Callable[[float], Image], timeout_s: float) -> Image:
    """What is seen from now on, RGB (height, width, 3).

    `frame` returns the next frame of the camera `name` before a moment of `time.monotonic`, or raises
    `CameraFault`. Raises `CameraFault` where no two frames in a row show the same, too.
    """
    deadline = time.monotonic() + timeout_s
    for _ in range(IN_FLIGHT):
        frame(deadline)
    before, now = frame(deadline), frame(deadline)
    while float(np.abs(now.astype(np.int16) - before).mean()) > STILL:
        if time.monotonic() > deadline:
            raise CameraFault(f"{name}: no two frames in a row show the same; does something move?")
        before, now = now, frame(deadline + FRAME_S)
    return now
