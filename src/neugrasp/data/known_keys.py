"""Keys of the JSON files that users hand in: which are known, and which of the others would bend geometry.

A reader says which keys it understands. Of the rest, those that change where a pixel or a camera is are
refused unless they say that nothing is changed; all others are named in a warning.
"""

from __future__ import annotations

import difflib
import logging
import re
import unicodedata
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.errors import InputError

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
    "fish|equi|spher|omni|panoram|kannala|theta|latlong|division|eucm|doublesphere|mei|unified|ortho|"
    "cylind|prism|vr180|fov|ucm|ocam|scaramuzza|^(ds|kb\\d*|atan\\w*|poly|polynomial\\d*|wideangle)$"
)
"""What names of other lenses hold."""


@dataclass(frozen=True)
class Bend:
    """A kind of key that bends geometry."""

    pattern: str
    """Of the whole key in lower-case letters and digits."""
    what: str
    """What such a key says."""
    remedy: str
    harmless: frozenset[Any] = frozenset()
    """Values, in lower case, that change nothing; besides null, false, zero, and nothing at all."""
    harmful: str = ""
    """Where words are mostly harmless (the name of a product, say), what those hold that are not."""

    def is_meant(self, key: str, value: Any) -> bool:
        """Whether the key is of this kind and its value changes anything."""
        return re.fullmatch(self.pattern, plain(key)) is not None and not self._is_harmless(value)

    def _is_harmless(self, value: Any) -> bool:
        if isinstance(value, str):
            word = plain(value)
            return not re.search(self.harmful, word) if self.harmful else word in self.harmless
        if isinstance(value, bool) or value is None:
            return not value
        if isinstance(value, int | float):
            return value in (0, *self.harmless)
        if isinstance(value, Mapping):
            return all(self._is_harmless(part) for name, part in value.items() if plain(name) not in SHAPES)
        return _changes_nothing(value)


SHAPES = {"rows", "cols", "columns", "dt", "size", "shape", "dtype", "format"}
"""Keys of an array that is written as an object."""
OF_A_CAMERA = re.compile(
    r"(?!depth|ir|infra)(\w*(calib|camera|lens|intrins|colou?r|rgb|optic|sensor)\w*|cams?\d*|meta(data)?|info|"
    r"settings|config|dataparser|normali[sz]ation)"
)
"""Objects within a file that describe the camera of its photos, or how its poses were made."""
REMARKS = frozenset(
    {"name", "comment", "comments", "note", "notes", "remark", "description", "author", "date", "title"}
    | {"format", "version", "source", "created", "timestamp", "time", "stamp", "header", "frameid", "frame"}
    | {"parent", "child", "childframeid", "id", "label"}
)
"""Keys in plain letters that say nothing of any number."""

BENDS = (
    Bend(
        r"(lens|camera|radial|tangential|thinprism|thin|rgb|color|colour)*(distort(?!ionmodel|iontype)\w*|dist|"
        r"distcoeffs?|distcoefs?|distparams?|distcoefficients?)|d|kc|coeffs?|coefficients|s[1-4]|"
        r"(lens|radial|tangential|dist)?[kp]\d+|kappa\d*|"
        r"tau[xy]|xi|radial|tangential|radialparams|radialcoeffs|tangentialcoeffs|omega|thinprism\w*",
        "is a coefficient of lens distortion",
        "undistort the photos and leave it away",
        frozenset({"none"}),
    ),
    Bend(
        r"(lens|distortion|projection)(model|type)|projection|is(fisheye|equirectangular|spherical|panorama|"
        r"omnidirectional)|fisheye\w*|equirectangular|spherical|panorama|ftheta\w*|latlong|omni\w*|mei|"
        r"equidistant|orthographic|lensmode",
        "is a lens that is no pinhole",
        "undistort the photos to a pinhole first",
        frozenset(PINHOLE_MODELS),
    ),
    Bend(
        r"(camera|sensor)?(model|type|lens)",
        "is a lens that is no pinhole",
        "undistort the photos to a pinhole first",
        harmful=NO_PINHOLE,
    ),
    Bend(
        r"rollingshutter\w*|shuttertype|shutter|readouttime|transformmatrix(start|end)",
        "is a camera that moves while it takes a photo",
        "take the photos at rest, with a global shutter, and leave it away",
        frozenset({"none", "global", "globalshutter", "mechanical"}),
    ),
    Bend(
        r"applied\w+|(world|scene|poses?|camera|unit|metric|avg|global)?(scale|scaling)(factor|mat\d*|tometric)?|"
        r"dataparser\w+|(pose|scene|world|global)transform|worldmat\d*|(m|mm|cm|met(er|re)s?)per(world)?unit|"
        r"unit(s?per|in)(m|mm|cm|met(er|re)s?)",
        "is a scale or a motion of the poses",
        "give poses in metres in your world and leave it away",
        frozenset({1}),
    ),
    Bend(
        r"(length|poses?|translation|position|distance)?units?|(?!focal|sensor|pixel)\w+(mm|cm|millimet(er|re)s?|"
        r"inches)",
        "is a unit of length",
        "give metres and leave it away",
        frozenset({"m", "metre", "metres", "meter", "meters", 1}),
    ),
    Bend(
        r"(camera|pose|coordinate|axis|axes)*(convention|coordinatesystem|coordinateframe|axes)|fromna|"
        r"handedness|quaternion(order|format)|cameraframe|(pose|transform)type|(is)?(w2c|worldtocam(era)?)",
        "is another convention of poses",
        "convert the poses as docs/conventions.md says and leave it away",
        frozenset({"opencv", "righthanded", "right", "xyzw"}),
    ),
    Bend(
        r"(sensor)?crop\w*|roi|regionofinterest|binning\w*|downscale\w*|downsample\w*|resize\w*|skew|"
        r"rectificationmatrix|rectification|r|[xy]offset|offset[xy]|mirror(ed)?|flip\w*|rotate\w*|zoom\w*|"
        r"(image|photo|pixel|intrinsics?)scale(factor)?|(exif|image|photo)?(orientation|rotation)|"
        r"calibrat(ion|ed)(width|height|size|resolution)",
        "is a change of the photo after the calibration",
        "give the intrinsics of the photo as it is on disk and leave it away",
        frozenset({1, "none"}),
    ),
)
"""One table for all readers; what one of them understands, it takes out by naming it as known."""


def plain(word: str) -> str:
    """A key or a name in lower-case letters and digits alone."""
    return re.sub(r"[^a-z0-9]", "", unicodedata.normalize("NFKC", word).lower())


def refuse_bends(
    entry: Mapping[str, Any], known: Collection[str], where: str, remedy: str | None = None
) -> None:
    """Raises `InputError` for a key outside `known` that would bend the geometry, with what to do; also for
    one within an object that is not known itself, but describes a camera by its name."""
    for key, value in entry.items():
        if key in known:
            continue
        for bend in BENDS:
            if bend.is_meant(key, value):
                what = f"{key!r} {bend.what}, which is not read here"
                raise InputError(f"{where}: {what}; {remedy or bend.remedy}")
        if OF_A_CAMERA.fullmatch(plain(key)):
            for part in value if isinstance(value, list) else [value]:
                if isinstance(part, Mapping):
                    refuse_bends(part, (), f"{where}: {key}", remedy)


def refuse_unknown(entry: Mapping[str, Any], known: Collection[str], where: str) -> None:
    """Raises `InputError` for a key outside `known` that is no remark, with the known one that is most like
    it: for objects in which every key is a measure, so that one left out is another measure."""
    for key in entry:
        if key not in known and not is_remark(key):
            hint = _meant(key, known)
            raise InputError(f"{where}: the key {key!r} is not known{hint or '; leave it away'}")


def is_remark(key: str) -> bool:
    """Whether a key is for people alone."""
    return key.startswith(("_", "$", "//")) or plain(key) in REMARKS


def _meant(key: str, known: Collection[str]) -> str:
    """The known key that is most like another, as a question."""
    like = difflib.get_close_matches(plain(key), [plain(word) for word in known], n=1)
    meant = next((word for word in sorted(known) if like and plain(word) == like[0]), None)
    return f"; did you mean {meant!r}?" if meant else ""


def warn_of_unknown(
    entries: Iterable[Mapping[str, Any]], known: Collection[str], file: Path | str, logger: logging.Logger
) -> None:
    """Names each key outside `known` once, with the known one that is most like it; a key that begins with an
    underscore, a dollar or a slash is a remark, and one that bends geometry is refused, not ignored."""
    for key, value in {key: value for entry in entries for key, value in entry.items()}.items():
        if key in known or key.startswith(("_", "$", "//")):
            continue
        if any(bend.is_meant(key, value) for bend in BENDS):
            continue
        logger.warning("%s: the key %r is not known and ignored%s", file, key, _meant(key, known))


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
