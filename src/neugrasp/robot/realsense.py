"""The colour camera of a RealSense: the only file that imports pyrealsense2. Its depth is not used.

Exposure and white balance are fixed, so that the empty table and the full one are photographed alike.
"""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any

import numpy as np

from neugrasp.errors import InputError, require
from neugrasp.geometry.lens import Lens
from neugrasp.observation import Image
from neugrasp.robot.errors import CameraFault, ConnectionLost
from neugrasp.robot.still_photo import still_photo

QUEUE = 2
FRAMES_PER_SECOND = 30
BENT = 1e-6
"""Coefficient of distortion from which a lens is bent."""
OTHER_FOCAL = 1.05
"""Factor by which the focal length of the cell file may differ from what the camera says of itself."""


class RealSense:
    """A camera by its serial number; the first one that is found where that is empty."""

    def __init__(self, serial: str, lens: Lens, exposure_us: int | None = None, device: Any = None):
        """Raises `ConnectionLost` where there is no such camera or stream, `InputError` where the camera
        says of itself that it has another lens, `MissingExtra` without the library. `device` is for tests."""
        self._library: Any = require("pyrealsense2", extra="robot")
        self._name = f"RealSense {serial or '(the first one)'}"
        self._sensor = self._colour_sensor(device or self._device(serial))
        profile = self._profile(lens.width, lens.height)
        self._check_lens(profile, lens)
        self._fix(exposure_us)
        self._queue = self._library.frame_queue(QUEUE, keep_frames=True)
        self._sensor.open(profile)
        self._sensor.start(self._queue)

    def __enter__(self) -> RealSense:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._sensor.stop()
        self._sensor.close()

    def photo(self, timeout_s: float) -> Image:
        """What is seen from now on, RGB (height, width, 3). Raises `CameraFault` where no frame comes, or
        none that is still."""
        return still_photo(self._name, self._frame, timeout_s)

    def _frame(self, deadline: float) -> Image:
        left_ms = max(1, round(1000 * (deadline - time.monotonic())))
        try:
            frame = self._queue.wait_for_frame(left_ms)
        except RuntimeError as error:
            raise CameraFault(f"{self._name}: no frame arrives ({error})") from error
        return np.array(frame.get_data(), dtype=np.uint8)

    def _device(self, serial: str) -> Any:
        info = self._library.camera_info.serial_number
        found = {device.get_info(info): device for device in self._library.context().query_devices()}
        if not found or (serial and serial not in found):
            there = ", ".join(found) or "none"
            raise ConnectionLost(f"{self._name}: not connected; connected: {there}")
        return found[serial] if serial else next(iter(found.values()))

    def _colour_sensor(self, device: Any) -> Any:
        colour = self._library.stream.color
        for sensor in device.query_sensors():
            if any(profile.stream_type() == colour for profile in sensor.get_stream_profiles()):
                return sensor
        raise ConnectionLost(f"{self._name}: it has no colour camera")

    def _profile(self, width: int, height: int) -> Any:
        library, sizes = self._library, set()
        for profile in self._sensor.get_stream_profiles():
            if profile.stream_type() != library.stream.color or profile.format() != library.format.rgb8:
                continue
            video = profile.as_video_stream_profile()
            sizes.add((video.width(), video.height()))
            if (video.width(), video.height(), profile.fps()) == (width, height, FRAMES_PER_SECOND):
                return profile
        offered = ", ".join(f"{w} x {h}" for w, h in sorted(sizes)) or "none"
        raise ConnectionLost(f"{self._name}: no stream of {width} x {height} at 30 Hz; there are: {offered}")

    def _check_lens(self, profile: Any, lens: Lens) -> None:
        """What the camera says of itself is less exact than a calibration, but no other lens."""
        said = profile.as_video_stream_profile().get_intrinsics()
        bends = [float(x) for x in said.coeffs]
        if max(map(abs, bends)) > BENT and not lens.is_distorted:
            raise InputError(
                f"{self._name}: says that its lens has distortion ({bends}), and the cell file says none; "
                "calibrate, and write camera.distortion"
            )
        ratio = lens.intrinsics[0, 0] / said.fx if said.fx > 0 else 1.0
        if not 1 / OTHER_FOCAL <= ratio <= OTHER_FOCAL:
            raise InputError(
                f"{self._name}: says fx = {said.fx:.1f} at this size, the cell file "
                f"{lens.intrinsics[0, 0]:.1f}; the intrinsics must be those of this stream"
            )

    def _fix(self, exposure_us: int | None) -> None:
        """Switches off whatever adapts; where the exposure is not given, it stays as it is."""
        option = self._library.option
        for automatic in (option.enable_auto_exposure, option.enable_auto_white_balance):
            if self._sensor.supports(automatic):
                self._sensor.set_option(automatic, 0)
        if exposure_us is not None and self._sensor.supports(option.exposure):
            self._sensor.set_option(option.exposure, exposure_us / 100)
