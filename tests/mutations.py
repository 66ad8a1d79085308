"""Documents spoilt at random, as hypothesis strategies: what a reader must survive."""

from __future__ import annotations

import copy
import json
from typing import Any

from hypothesis import strategies as st

KEYS = (
    *("k1", "k4", "D", "K", "distortion", "distortion_params", "dist_coeffs", "camera_matrix", "coeffs"),
    *(
        "fl_x",
        "camera_angle_x",
        "x_fov",
        "w",
        "h",
        "width",
        "image_size",
        "cx",
        "intrinsics",
        "applied_scale",
    ),
    *("applied_transform", "camera_model", "is_fisheye", "rolling_shutter", "unit", "scale", "_remark", ""),
    *(
        "image",
        "file_path",
        "views",
        "frames",
        "tags",
        "size",
        "centre",
        "center",
        "turn_deg",
        "id",
        "legacy",
    ),
)
json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers(-(10**25), 10**25)
    | st.floats()
    | st.text(max_size=4)
    | st.sampled_from(
        ["", "..", "a/b", "\\", "fisheye", "opencv", "none", "1.5", "\ud800", "\x1b[2J", "C:\\x"]
    ),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.sampled_from(KEYS), inner, max_size=3),
    max_leaves=8,
)


def places(document: Any, above: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """The way to every value below the document."""
    keys = (
        document if isinstance(document, dict) else range(len(document)) if isinstance(document, list) else ()
    )
    return [way for key in keys for way in ((*above, key), *places(document[key], (*above, key)))]


@st.composite
def spoilt(draw: st.DrawFn, document: dict[str, Any]) -> dict[str, Any]:
    """The document with one to three values replaced, removed, moved to another key or made lists."""
    data = copy.deepcopy(document)
    for _ in range(draw(st.integers(1, 3))):
        ways = places(data)
        if not ways:
            break
        *above, last = draw(st.sampled_from(ways))
        owner = data
        for key in above:
            owner = owner[key]
        action = draw(st.sampled_from(["replace", "remove", "rename", "add", "nest", "scale"]))
        if action == "remove":
            del owner[last]
        elif action in ("rename", "add") and isinstance(owner, dict):
            value = owner.pop(last) if action == "rename" else draw(json_values)
            owner[draw(st.sampled_from(KEYS))] = value
        elif action == "nest":
            owner[last] = [owner[last]]
        elif action == "scale" and isinstance(owner[last], float | int):
            owner[last] *= draw(st.sampled_from([-1, 0, 1e-3, 1000, 1e30, 1e300]))
        else:
            owner[last] = draw(json_values)
    return data


@st.composite
def spoilt_text(draw: st.DrawFn, text: str) -> bytes:
    """The text with a few stretches of it removed, doubled or overwritten, as bytes."""
    data = text.encode()
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 40)))
        piece = draw(
            st.binary(max_size=6)
            | st.sampled_from(
                [b"", b"\n", b"\r\n", b" ", b"nan", b"1e999", b"-1", b"\xef\xbb\xbf", b'"', b"[["]
            )
            | st.just(2 * data[start:end])
            | st.integers(0, 10**40).map(lambda n: str(n).encode())
        )
        data = data[:start] + piece + data[end:]
    return data


@st.composite
def spoilt_bytes(draw: st.DrawFn, data: bytes) -> bytes:
    """A binary file with a few bytes of it removed, doubled or overwritten."""
    for _ in range(draw(st.integers(1, 3))):
        start = draw(st.integers(0, len(data)))
        end = min(len(data), start + draw(st.integers(0, 8)))
        data = data[:start] + draw(st.binary(max_size=8) | st.just(2 * data[start:end])) + data[end:]
    return data


def as_json(document: Any) -> bytes:
    """As a program would write it, NaN and halves of characters and all."""
    return json.dumps(document).encode("utf-8", "surrogatepass")
