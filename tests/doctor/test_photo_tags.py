"""What photos say of themselves reaches the doctor and `predict`, and is compared with scene.json."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from neugrasp.data.photo_files import AS_STORED, Tags, photo_tags
from neugrasp.data.scene_folder import read_scene, write_scene
from neugrasp.doctor.examination import examine_folder, examine_read
from neugrasp.doctor.findings import Finding, Level
from neugrasp.doctor.messages import OTHER_LENS, ROTATION_TAG
from neugrasp.observation import Views

DETAILS = 0x8769


@pytest.fixture
def scene(good: Views, tmp_path: Path) -> Path:
    write_scene(tmp_path, good)
    return tmp_path


@pytest.fixture
def film(good: Views) -> float:
    """The focal length of the good capture, of 35 mm film."""
    camera = good.frames[0].camera
    return float(camera.intrinsics[0, 0] * np.hypot(36, 24) / np.hypot(camera.width, camera.height))


def tag(file: Path, details: dict[int, object], **first: int) -> None:
    with Picture.open(file) as picture:
        tags = picture.getexif()
        tags[DETAILS] = details
        if first:
            tags[274] = first["orientation"]
        picture.save(file, exif=tags)


def everywhere(scene: Path) -> list[Path]:
    return sorted(scene.glob("*/*.png"))


def findings(scene: Path) -> list[Finding]:
    """Yellow ones: the same for the doctor and for the quick look of `predict`."""
    thorough = [f for f in examine_folder(scene).findings if f.level >= Level.YELLOW]
    quick = [f for f in examine_read(read_scene(scene)).findings if f.level >= Level.YELLOW]
    assert thorough == quick
    return thorough


@pytest.mark.slow
@pytest.mark.parametrize("value", sorted(AS_STORED))
def test_turned_and_mirrored_photos_are_named_with_how_they_lie(scene: Path, value: int):
    tag(scene / "images/1.png", {}, orientation=value)
    (finding,) = findings(scene)
    assert finding.problem is ROTATION_TAG
    assert finding.measured == f"EXIF orientation is not 1: images/1.png is stored {AS_STORED[value]}"


@pytest.mark.slow
@pytest.mark.parametrize("factor", [0.5, 0.75, 1.4, 2.0, 5.0])
def test_another_focal_length_than_that_of_the_intrinsics_is_named(scene: Path, film: float, factor: float):
    for file in everywhere(scene):
        tag(file, {0xA405: round(factor * film)})
    (finding,) = findings(scene)
    assert finding.problem is OTHER_LENS
    measured = round(factor * film) / film
    assert f"{measured:.2f} times the focal length in scene.json" in finding.measured


@pytest.mark.slow
def test_a_phone_that_changed_its_lens_between_photo_and_background(scene: Path, film: float):
    """Neither is far from the intrinsics, which lie between the two."""
    tag(scene / "images/0.png", {0xA405: round(0.85 * film)})
    tag(scene / "backgrounds/0.png", {0xA405: round(1.18 * film)})
    (finding,) = findings(scene)
    assert finding.problem is OTHER_LENS
    assert "images/0.png was taken at" in finding.measured
    assert "backgrounds/0.png at" in finding.measured


@pytest.mark.slow
@pytest.mark.parametrize(
    "details",
    [
        lambda film: {0xA405: round(film)},
        lambda film: {0xA405: round(1.15 * film)},
        lambda film: {0xA405: 0},
        lambda film: {0xA405: "26 mm"},
        lambda film: {0xA405: 60000},
        # Cropped: what was 3000 x 4000 has other proportions now.
        lambda film: {0xA405: round(3 * film), 0xA002: 4000, 0xA003: 4000},
    ],
)
def test_what_fits_or_says_nothing_is_no_finding(
    scene: Path, film: float, details: Callable[[float], dict[int, object]]
):
    for file in everywhere(scene):
        tag(file, details(film))
    assert findings(scene) == []


def test_the_proportions_count_however_a_photo_was_turned(tmp_path: Path):
    file = tmp_path / "a.jpg"
    Picture.new("RGB", (400, 300)).save(file)
    for sides in ((4000, 3000), (3000, 4000), (0, 0)):
        tag(file, {0xA405: 26, 0xA002: sides[0], 0xA003: sides[1]})
        assert photo_tags(file, "view 0") == Tags(None, 26.0, pytest.approx(26 * 500 / np.hypot(36, 24)))
    tag(file, {0xA405: 26, 0xA002: 4000, 0xA003: 4000})
    assert photo_tags(file, "view 0") == Tags(None, 26.0, None)


def behind_the_pixels(file: Path) -> None:
    """Moves the tags of a PNG to its end, where some programs write them."""
    chunks, data = [], file.read_bytes()[8:]
    while data:
        end = int.from_bytes(data[:4], "big") + 12
        chunks.append(data[:end])
        data = data[end:]
    tags = [chunk for chunk in chunks if chunk[4:8] == b"eXIf"]
    rest = [chunk for chunk in chunks if chunk[4:8] != b"eXIf"]
    assert len(tags) == 1
    file.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join([*rest[:-1], *tags, rest[-1]]))


def test_tags_behind_the_pixels_are_found_and_nothing_is_decoded_for_none(scene: Path, monkeypatch):
    tag(scene / "images/0.png", {}, orientation=6)
    behind_the_pixels(scene / "images/0.png")
    assert photo_tags(scene / "images/0.png", "here").lies == AS_STORED[6]
    monkeypatch.setattr(Picture.core, "zip_decoder", None)
    assert photo_tags(scene / "images/1.png", "here") == Tags()
