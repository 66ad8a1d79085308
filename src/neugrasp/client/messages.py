"""What is sent to a server and what comes back, whoever carries it."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from urllib.parse import quote

from PIL import Image as Picture

from neugrasp.data.fields import Fields
from neugrasp.data.scene_folder import FILE, photo_of, read_json, scene_document
from neugrasp.data.strict_json import parse_json
from neugrasp.data.user_files import read_bytes
from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.observation import Image, Views

Photos = Sequence[Path | str | Image]
Part = tuple[str, tuple[str, bytes]]


class ServerError(NeuGraspError):
    """A server cannot be reached, does not take the token, is busy for too long, or is none."""


@dataclass(frozen=True)
class Answer:
    """A detection, and what else the server says."""

    detection: Detection
    verdict: str
    """The doctor's word on the capture."""
    findings: tuple[str, ...]
    """What the doctor noticed, one line each."""
    seconds: Mapping[str, float]
    """Seconds of the server's stages; the detector's own are in `detection.timing_s`."""
    request: str
    """The name of the request in the server's log."""


@dataclass(frozen=True)
class Request:
    """What is sent, whoever sends it."""

    method: str
    path: str
    parts: tuple[Part, ...] = ()
    fields: Mapping[str, str] = field(default_factory=dict)
    source: str = ""
    """Where the photos come from, for the detection."""

    def options(self) -> dict[str, Any]:
        """As httpx takes it."""
        return {"files": list(self.parts), "data": dict(self.fields)} if self.parts else {}


def keeping(name: str, scene: str | Path | Views) -> Request:
    """Cameras and backgrounds of a scene for a cell. Raises `InputError` where a file cannot be read."""
    document, _, backgrounds, _ = _scene(scene, images=False)
    return Request("PUT", f"/v1/cells/{quote(name, safe='')}", (document, *backgrounds))


def asking(scene: str | Path | Views, steering: Steering | None, force: bool) -> Request:
    """A whole scene. Raises as `keeping`."""
    document, images, backgrounds, source = _scene(scene)
    wanted, fields = _steering(steering)
    parts = (document, *images, *backgrounds, *wanted)
    return Request("POST", f"/v1/detect{_query(force)}", parts, fields, source)


def asking_at(cell: str, images: Photos, steering: Steering | None, force: bool) -> Request:
    """Photos at a cell. Raises as `keeping`."""
    wanted, fields = _steering(steering)
    parts = (*(_photo("image", i, image) for i, image in enumerate(images)), *wanted)
    return Request("POST", f"/v1/cells/{quote(cell, safe='')}/detect{_query(force)}", parts, fields)


def _query(force: bool) -> str:
    return f"?tsdf=true&force={str(force).lower()}"


def _scene(scene: str | Path | Views, images: bool = True) -> tuple[Part, list[Part], list[Part], str]:
    """scene.json, the photos, those of the empty table, and where they come from."""
    if isinstance(scene, Views):
        document = json.dumps(scene_document(scene)).encode()
        seen = [_photo("image", i, view.image) for i, view in enumerate(scene.frames) if images]
        empty = [_photo("background", i, view.background) for i, view in enumerate(scene.frames)]
        return ("scene", (FILE, document)), seen, empty, scene.source
    path = Path(scene)
    folder = path.parent if path.name == FILE else path
    entries = read_json(folder / FILE).get("views")
    if not isinstance(entries, list):
        raise InputError(f"{folder / FILE}: 'views' must be a list of views")
    parts: dict[str, list[Part]] = {"image": [], "background": []}
    for i, entry in enumerate(entries):
        for key in ("image", "background") if images else ("background",):
            where = f"{folder / FILE}, view {i}"
            given = Fields(where, entry).data
            parts[key].append(_photo(key, i, photo_of(folder, given, key, where)))
    document = read_bytes(folder / FILE)
    return ("scene", (FILE, document)), parts["image"], parts["background"], str(folder.resolve())


def _photo(part: str, number: int, photo: Path | str | Image) -> Part:
    if isinstance(photo, Path | str):
        try:
            return part, (Path(photo).name, read_bytes(Path(photo)))
        except FileNotFoundError:
            raise InputError(f"{photo}: missing") from None
    stream = io.BytesIO()
    Picture.fromarray(photo).save(stream, format="PNG", compress_level=1)
    return part, (f"{part} {number}.png", stream.getvalue())


def _steering(steering: Steering | None) -> tuple[list[Part], dict[str, str]]:
    """What is wanted, as a field, and the mask as a part."""
    if steering is None:
        return [], {}
    names = ("region", "approach", "min_height", "one_object", "top")
    wanted = {name: value for name in names if (value := getattr(steering, name)) not in (None, False)}
    if steering.mask is None:
        return [], {"steering": json.dumps(wanted)}
    view, file = steering.mask
    return [_photo("mask", view, file)], {"steering": json.dumps({**wanted, "mask_view": view})}


def content_of(status: int, body: bytes, url: str) -> Fields:
    """The object in an answer. Raises `InputError` or `ServerError` where it is none."""
    try:
        content = Fields(url, parse_json(body or b"{}", url))
    except InputError as error:
        raise ServerError(f"{url}: is no server of NeuGrasp ({status}: {error})") from error
    if status < 400:
        return content
    said = f"{url}: {content.data.get('detail', status)}"
    if status in (400, 404, 409, 413, 422):
        verdict = content.data.get("doctor")
        raise InputError("\n".join([said, *(_findings(content.inside("doctor")) if verdict else ())]))
    raise ServerError(said)


def _findings(doctor: Fields) -> list[str]:
    """One line for each finding."""
    return [
        f"{one.text('level'):<7} {one.text('item'):<22} {one.text('measured')}. {one.text('remedy')}".rstrip(
            ". "
        )
        for one in doctor.each("findings")
    ]


def answer_of(content: Fields, request: Request) -> Answer:
    detection = Detection.from_dict(content.get("detection"), f"{content.source}, detection")
    doctor = content.inside("doctor")
    return Answer(
        replace(detection, source=request.source),
        doctor.text("verdict"),
        tuple(_findings(doctor)),
        content.inside("seconds").each_number(0, 1e9),
        content.text("request"),
    )
