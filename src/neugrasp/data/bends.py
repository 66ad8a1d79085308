"""Keys that bend geometry, by kinds: one table for all readers of JSON.

What a reader understands, it takes out by naming it as known. A pattern is of the whole key in plain letters.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from neugrasp.data.spelling import plain

PINHOLE_MODELS = {
    *("", "none", "pinhole", "simplepinhole", "perspective", "ideal", "rectilinear", "undistorted"),
    *(
        "rectified",
        "opencv",
        "simpleradial",
        "radial",
        "fullopencv",
        "radtan",
        "radialtangential",
        "standard",
    ),
    *("plumbbob", "brownconrady", "rationalpolynomial", "opencvpinhole", "brown"),
}
"""Names of models that are a pinhole but for their coefficients, in letters alone."""
NO_PINHOLE = (
    "fish|equi|spher|omni(?!vision)|panoram|kannala|theta|latlong|division|eucm|doublesphere|mei|unified|"
    "ortho|cylind|prism|vr180|fov|ucm|ocam|scaramuzza|^(ds|kb\\d*|atan\\w*|poly|polynomial\\d*|wideangle)$"
)
"""What names of other lenses hold."""
SHAPES = {"rows", "cols", "columns", "dt", "size", "shape", "dtype", "format"}
"""Keys of an array that is written as an object."""
NO = {"false", "no", "off", "0", "none", "n"}


@dataclass(frozen=True)
class Bend:
    """A kind of key that bends geometry."""

    pattern: str
    """Pattern of the whole key in lower-case letters and digits."""
    what: str
    """What such a key says."""
    remedy: str
    harmless: frozenset[Any] = frozenset()
    """Values, in lower case, that change nothing; besides null, false, zero, and nothing at all."""
    harmful: str = ""
    """Where words are mostly harmless (the name of a product, say), what those hold that are not; values that
    are no words are then another's matter."""
    denies: bool = False
    """Whether the key says that all is well, so that it is false, or no, that does harm."""

    def is_meant(self, word: str, value: Any) -> bool:
        """Whether a plain key is of this kind and its value changes anything."""
        return re.fullmatch(self.pattern, word) is not None and not self._is_harmless(value)

    def _is_harmless(self, value: Any) -> bool:
        if self.denies:
            return value is not False and not (isinstance(value, str) and plain(value) in NO)
        if isinstance(value, str):
            word = plain(value)
            return not re.search(self.harmful, word) if self.harmful else word in self.harmless
        if self.harmful or value is None:
            return True
        if isinstance(value, bool):
            return not value
        if isinstance(value, int | float):
            return value in (0, *self.harmless)
        if isinstance(value, Mapping):
            return all(self._is_harmless(part) for name, part in value.items() if plain(name) not in SHAPES)
        return _changes_nothing(value)


CAMERA = "(camera|cam|sensor|lens|optics?|image|img|photo|rgb|colou?r|calib(ration)?|intrinsics?|opencv)*"
METRES = "met(er|re)s?"
BENDS = (
    Bend(
        rf"\w*(?<!un)disto(?!rt(ion)?(model|type)$)\w*|{CAMERA}dist(coe?f\w*|par\w*|vec\w*|k\d|p\d)?|d|kc|"
        rf"{CAMERA}(radial|tangential|brown\w*|undist\w*|thin\w*|k)?(coe?ff?s?|coefficients?)\w*|"
        rf"(lens|opencv|undist\w*|brown\w*)par(ameter|am)s?|(\w*(lens|radial|tangential|dist))?[kp]\d+|s[1-4]|"
        r"kappa\d*|t(au)?[xy]|xi|radial(params)?|tangential(params)?|omega|thinprism\w*|brown(conrady)?|radtan|"
        r"plumbbob|barrel\w*|pincushion\w*|verzeichnung|verzerrung",
        "is a coefficient of lens distortion",
        "undistort the photos and leave it away",
        frozenset({"none"}),
    ),
    Bend(
        r"\w*(lens|distortion|projection|proj)(model|type|function|kind)|\w*projection|is(fisheye|spherical|"
        r"equirectangular|panorama|omnidirectional)|fisheye\w*|equirectangular|spherical|panorama|ftheta\w*|"
        r"latlong|omni\w*|mei|equidistant|orthographic|lensmode|thinlens|refracti\w*|underwater",
        "is a lens that is no pinhole",
        "undistort the photos to a pinhole first",
        frozenset(PINHOLE_MODELS),
    ),
    Bend(
        r"(camera|cam|sensor|lens|optics?)?(model|type|kind|class|mode|lens|optics?|profile)|lensname|camera|cam",
        "is a lens that is no pinhole",
        "undistort the photos to a pinhole first",
        harmful=NO_PINHOLE,
    ),
    Bend(
        r"(is|uses|has)?rolling\w*|shutter(type|mode)?|readout\w*|(scan)?line(delay|time|readout)\w*|scanlines?|"
        r"interlaced|transformmatrix(start|end)|camera(linear|angular)velocity",
        "is a camera that moves while it takes a photo",
        "take the photos at rest, with a global shutter, and leave it away",
        frozenset({"none", "global", "globalshutter", "mechanical"}),
    ),
    Bend(
        r"\w*(crop|flip|mirror|zoom|binning|downscal|downsampl|subsampl|resiz)\w*|roi|regionofinterest|skew|"
        r"shear|affinity|b[12]|rectificationmatrix|rectification|r|"
        r"(image|photo|pixel|intrinsics?)scale(factor)?|scale[xy]|pixelaspect(ratio)?[xy]?|rotated?|"
        r"(exif|image|img|photo|pixel|display)*(orientation|rotat\w*|rot|transpos\w*)(deg\w*|\d+)?|upsidedown|"
        r"(lens|sensor|image|optical|c[xy]|principal\w*|pp[xy]?)*(shift|offset|tilt)[xy]?|[xy]offset|tilt|"
        r"halfres\w*|calib\w*(width|height|size|resolution|w|h)",
        "is a change of the photo after the calibration",
        "give the intrinsics of the photo as it is on disk and leave it away",
        frozenset({1, "none"}),
    ),
    Bend(
        r"applied\w+|(?!depth|int\w*depth|gr[ae]y|loss|colou?r|aabb)\w*scal(e|ed|ing)(?!bar)\w*|dataparser\w+|"
        rf"(pose|scene|world|global|camera)transform|worldmat\d*|(m|mm|cm|{METRES})per(world)?unit|"
        rf"unit(s?per|in)(m|mm|cm|{METRES})|(unit|pose|scene|world)s?to(m|mm|cm|{METRES})|to{METRES}|"
        r"(unit|pose|scene|world|metric)s?(multiplier|factor|ratio)|normali[sz](ed|ation)",
        "is a scale or a motion of the poses",
        "give poses in metres in your world and leave it away",
        frozenset({1}),
    ),
    Bend(
        r"((world|base|robot|flange|tool|tcp|hand|eye|gripper|mount|pose|camera|calib\w*)s?)+(offset|shift|"
        r"correction|translation|adjustment)\w*|tcp|tool(pose|frame|length)?",
        "is a motion of the poses",
        "put it into the poses and leave it away",
    ),
    Bend(
        rf"(?!depth)\w*units?(in|of\w+)?|(?!focal|sensor|pixel)\w+(mm|cm|millimet(er|re)s?|inch(es)?)|"
        rf"(milli|centi){METRES}|inch(es)?|feet",
        "is a unit of length",
        "give metres and leave it away",
        frozenset({"m", "metre", "metres", "meter", "meters", "rad", "radian", "radians", "px", "pixels", 1}),
    ),
    Bend(
        r"\w*(convention|coord(inate)?s?(sys(tem)?|frame)|handed(ness)?)|coord(inate)?s|(camera|pose)?axes|quat(ernion)?s?|"
        r"axis(order|system)|fromna|(quat\w*|rotation|euler|matrix|extrinsics?|pose|transform)s?(order|format|"
        r"direction|representation|layout|type)|cameraframe|(is)?(w2c|world(2|to)cam(era)?|(open)?gl|"
        r"col(umn)?major|invert(ed)?|inverse)",
        "is another convention of poses",
        "convert the poses as docs/conventions.md says and leave it away",
        frozenset({"opencv", "righthanded", "right", "xyzw", "c2w", "cameratoworld", "worldfromcamera"})
        | frozenset({"rowmajor", "matrix"}),
    ),
    Bend(
        r"(\w*cam(era)?|intrinsics?)?(k|matrix|mat)|intrinsics?\w*|f[xy]|fl[xy]|focal(length)?(x|y|px|pixels?)?|"
        r"c[xy]|pp[xy]|principalpoint|optical(center|centre)|cameraangle[xy]|[xy]?[hv]?fov[xyhv]?(deg\w*)?",
        "says intrinsics another way",
        "say them once and leave it away",
    ),
    Bend(
        rf"(is|are|was|were|in|already)*(undistorted|rectified|pinhole|globalshutter|metric|metre|{METRES}|c2w|"
        r"cam(era)?(2|to)world|righthanded|rowmajor)",
        "says that something is not as it must be",
        "mend that and leave it away",
        denies=True,
    ),
)
TYPICAL = {
    *("distortion", "distortioncoefficients", "distortionparameters", "distcoeffs", "lensdistortion"),
    *("radialdistortion", "tangentialdistortion", "distortionmodel", "fisheye", "equirectangular"),
    *("rollingshutter", "appliedscale", "appliedtransform", "coordinatesystem", "quaternionorder"),
}
"""Plain keys whose misspellings are taken for them."""
ALIKE = 0.84
"""Share of letters that a misspelling has in common; "distribution" and "distortion" have 0.82."""


def bend_of(key: str, value: Any) -> Bend | None:
    """Which kind a key is of, misspelt or not, if its value changes anything."""
    word = plain(key)
    for spelling in (word, *difflib.get_close_matches(word, TYPICAL, n=1, cutoff=ALIKE)):
        if found := next((bend for bend in BENDS if bend.is_meant(spelling, value)), None):
            return found
    return None


def _changes_nothing(value: Any) -> bool:
    """Whether a list holds zeros, nothing, or an identity matrix."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return False
    if not array.any():
        return True
    size = round(array.size**0.5)
    is_square = array.ndim > 0 and size > 1 and size * size == array.size
    return is_square and bool(np.allclose(array.reshape(size, size), np.eye(size), atol=1e-9))
