"""Camera models of COLMAP: pixels counted from the corner."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from neugrasp.errors import InputError
from neugrasp.geometry.lens import Lens
from neugrasp.importers.foreign_lens import lens_from_corner

MODELS = {
    "SIMPLE_PINHOLE": 3,
    "PINHOLE": 4,
    "SIMPLE_RADIAL": 4,
    "RADIAL": 5,
    "OPENCV": 8,
    "OPENCV_FISHEYE": 8,
    "FULL_OPENCV": 12,
    "FOV": 5,
    "SIMPLE_RADIAL_FISHEYE": 4,
    "RADIAL_FISHEYE": 5,
    "THIN_PRISM_FISHEYE": 12,
    "RAD_TAN_THIN_PRISM_FISHEYE": 16,
    "SIMPLE_DIVISION": 4,
    "DIVISION": 5,
    "SIMPLE_FISHEYE": 3,
    "FISHEYE": 4,
    "EUCM": 6,
}
"""Numbers of parameters, in the order of the models' numbers in binary files."""
PINHOLES = ("SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV")
ONE_FOCAL_LENGTH = ("SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
REMEDY = (
    "reconstruct again with `colmap feature_extractor --ImageReader.camera_model OPENCV`: its photos are "
    "undistorted here, and their backgrounds with them, which `colmap image_undistorter` cannot do as they "
    "are not in the model"
)


@dataclass(frozen=True)
class ColmapCamera:
    """A line of cameras.txt or an entry of cameras.bin, not judged yet."""

    file: Path
    number: int
    model: str
    width: int
    height: int
    parameters: tuple[float, ...]

    def lens(self) -> Lens:
        """The lens. Raises `InputError` where the model is no pinhole, or where its numbers are none."""
        where = f"{self.file}: camera {self.number}, {self.model}"
        if self.model not in PINHOLES or (self.model == "FULL_OPENCV" and any(self.parameters[9:])):
            raise InputError(
                f"{where} cannot be undistorted here, only {', '.join(PINHOLES)} (the last without k4 to "
                f"k6); {REMEDY}"
            )
        if MODELS[self.model] != len(self.parameters):
            raise InputError(
                f"{self.file}: {self.model} has {MODELS[self.model]} parameters, not {len(self.parameters)}"
            )
        return _lens(self.model, self.parameters, (self.width, self.height), where)


def model_of(number: int, file: Path) -> str:
    """The name of a model in a binary file. Raises `InputError` where it is not known how long its entry "
    "is."""
    names = list(MODELS)
    if not 0 <= number < len(names):
        known = "EQUIRECTANGULAR" if number == len(names) else f"number {number}, unknown here"
        raise InputError(
            f"{file}: a camera of the model {known}, which cannot be undistorted here; {REMEDY}. If that "
            "camera's photos are not wanted: `colmap model_converter --output_type TXT`, whose lines can be "
            "read one by one"
        )
    return names[number]


def _lens(model: str, values: Sequence[float], size: tuple[int, int], where: str) -> Lens:
    has_one = model in ONE_FOCAL_LENGTH
    focal = (values[0], values[0] if has_one else values[1])
    cx, cy, *bends = values[1 if has_one else 2 :]
    # k1 and k2, then, in the models of OpenCV, p1, p2 and k3.
    k1, k2, p1, p2, k3 = [*bends, *[0.0] * 5][:5]
    return lens_from_corner(focal, (cx, cy), size, where, (k1, k2, k3), (p1, p2))
