"""The photo that a name means, or a true sentence; a background is never looked for outside its folder."""

from __future__ import annotations

import logging
import os
from pathlib import Path

import pytest

from neugrasp.errors import InputError
from neugrasp.importers.photo_folder import PhotoFolder, key_of, parts_of
from neugrasp.importers.photos import Photos


def filled(folder: Path, *names: str) -> Path:
    for name in names:
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(name.encode())
    return folder


@pytest.mark.parametrize(
    "name",
    [
        *(
            "0.png",
            "./0.png",
            "images/0.png",
            "./../images/0.png",
            "../../x/0.png",
            "/data/shot/images/0.png",
        ),
        *("..\\images\\0.png", "C:\\shots\\0.png", "C:/shots/0.png", ".\\0.png", "images/../0.png"),
        *("0.PNG", "0.jpg", "0.HEIC", "0.tiff", "0", "a/b/c/0.webp", "0.jfif", "0.camraw", "0.X3F"),
    ],
)
def test_a_name_leads_to_the_photo_in_the_folder(tmp_path: Path, name: str):
    folder = PhotoFolder(filled(tmp_path / "backgrounds", "0.png", "1.png"))
    assert folder.find(name) == tmp_path / "backgrounds/0.png"


def test_folders_in_the_name_come_first(tmp_path: Path):
    names = ["rig/cam0/0.png", "rig/cam1/0.png", "cam2/0.png", "0.png"]
    folder = PhotoFolder(filled(tmp_path, *names))
    for name in names:
        assert folder.find(name) == tmp_path / name
    assert folder.find("images/rig/cam1/0.jpg") == tmp_path / "rig/cam1/0.png"
    assert folder.find("rig\\cam0\\0.png") == tmp_path / "rig/cam0/0.png"
    assert folder.find("cam7/0.png") == tmp_path / "0.png"
    assert folder.find("cam7/1.png") is None
    assert folder.find("0.0001") is None


def test_capitals_and_the_way_of_accents_make_no_difference(tmp_path: Path):
    folder = PhotoFolder(filled(tmp_path, "IMG_1.JPG", "T\u00fcr.png"))
    assert folder.find("img_1.jpg") == tmp_path / "IMG_1.JPG"
    assert folder.find("Tu\u0308r.png") == tmp_path / "T\u00fcr.png"


def test_the_file_most_like_the_name_is_taken_and_doubt_is_told(tmp_path: Path):
    folder = PhotoFolder(filled(tmp_path, "a.png", "a.jpg", "A.png", "b.jpg", "b.jpeg", "c.png", "C.png"))
    assert folder.find("a.png") == tmp_path / "a.png"
    assert folder.find("A.png") == tmp_path / "A.png"
    assert folder.find("a.jpg") == tmp_path / "a.jpg"
    assert folder.find("b.jpg") == tmp_path / "b.jpg"
    for name, both in (("b.HEIC", r"b\.jpeg or b\.jpg"), ("b", r"b\.jpeg or b\.jpg")):
        with pytest.raises(InputError, match=f"'{name}' may be {both}"):
            folder.find(name)


@pytest.mark.timeout(20)
def test_pipes_hidden_files_and_folders_are_no_photos(tmp_path: Path):
    filled(tmp_path, ".0.png", ".cache/0.png", "1.png/x.txt", "notes.txt")
    os.mkfifo(tmp_path / "2.png")
    folder = PhotoFolder(tmp_path)
    assert folder.photos == []
    assert folder.find("2.png") is None
    with pytest.raises(InputError, match=r"no photos; it must hold \.png or \.jpg files$"):
        folder.names()


def test_links_are_followed_once_and_not_out_of_a_closed_folder(tmp_path: Path):
    filled(tmp_path / "elsewhere", "0.png", "cam/1.png")
    folder = filled(tmp_path / "backgrounds", "2.png")
    (folder / "0.png").symlink_to(tmp_path / "elsewhere/0.png")
    (folder / "cam").symlink_to(tmp_path / "elsewhere/cam")
    (folder / "loop").symlink_to(folder)
    (folder / "3.png").symlink_to(folder / "2.png")
    assert PhotoFolder(folder).find("0.png") == folder / "0.png"
    assert PhotoFolder(folder).find("cam/1.png") == folder / "cam/1.png"
    closed = PhotoFolder(folder, is_closed=True)
    assert closed.find("3.png") == folder / "3.png"
    for name in ("0.png", "cam/1.png"):
        with pytest.raises(InputError, match="is a link that leaves the folder"):
            closed.find(name)
    (tmp_path / "linked").symlink_to(folder)
    assert PhotoFolder(tmp_path / "linked", is_closed=True).find("2.png") is not None


def test_photos_of_another_kind_are_named(tmp_path: Path, caplog: pytest.LogCaptureFixture):
    folder = PhotoFolder(filled(tmp_path / "a", "0.HEIC", "1.heic", "2.dng"))
    with pytest.raises(InputError, match=r"no photos; .* it holds HEIC, raw files, which are not read"):
        folder.names()
    assert "HEIC files" in folder.foreign_hint(["images/0.png"])
    assert not folder.foreign_hint(["images/9.png"])
    mixed = PhotoFolder(filled(tmp_path / "b", "0.jpg", "0.HEIC", "1.HEIC"))
    with caplog.at_level(logging.WARNING):
        assert mixed.names() == ["0.jpg"]
    assert "1.HEIC left out" in caplog.text


@pytest.mark.parametrize("name", ["", "..", "/", "a/..", "C:", "a\nb.png", "a\x1b[2J.png", "a\0.png"])
def test_what_is_no_name_is_refused(name: str):
    with pytest.raises(InputError, match=r"no name of a photo|control characters"):
        parts_of(name)


def test_keys():
    for name in ("c.png", "C.JPG", "c.heic", "c"):
        assert key_of(name) == "c"
    assert key_of("frame.0001") == key_of("frame.0001.png") == "frame.0001"


@pytest.fixture
def rig(tmp_path: Path) -> Photos:
    names = ["cam0/0.png", "cam0/1.png", "cam1/0.png", "cam1/1.png"]
    images, backgrounds = filled(tmp_path / "images", *names), filled(tmp_path / "backgrounds", *names)
    return Photos(PhotoFolder(images), PhotoFolder(backgrounds, is_closed=True))


NAMES = ["cam0/0.png", "cam0\\1.png", "cam1/0.png", "cam1/1.png"]


@pytest.mark.parametrize(
    "words", [("cam0/0", "cam1/1.png"), ("cam0/0.png", "cam1\\1"), ("cam0/0.HEIC", "CAM1/1")]
)
def test_views_of_a_rig_are_chosen_with_their_folder(rig: Photos, words: tuple[str, ...]):
    chosen = Photos(rig.images, rig.backgrounds, words)
    assert list(chosen.pairs(NAMES)) == ["cam0/0.png", "cam1/1.png"]
    with pytest.raises(
        InputError, match=r"--views 0: 2 photos of that name; .*: cam0/0\.png, cam1/0\.png; name"
    ):
        Photos(rig.images, rig.backgrounds, ("0",)).pairs(NAMES)


def test_one_background_never_stands_for_two_photos(tmp_path: Path, rig: Photos):
    backgrounds = PhotoFolder(filled(tmp_path / "flat", "0.png", "1.png"), is_closed=True)
    for chosen in ((), ("cam1/0",)):
        with pytest.raises(InputError, match=r"flat/0\.png: stands for both"):
            Photos(rig.images, backgrounds, chosen).pairs(NAMES)


def test_a_photo_is_never_its_own_background(tmp_path: Path):
    images = filled(tmp_path / "images", "0.png", "1.png")
    with pytest.raises(InputError, match=r"0\.png: is the photo 0\.png and its background at once"):
        Photos(PhotoFolder(images), PhotoFolder(images)).pairs(["0.png"])
    backgrounds = filled(tmp_path / "backgrounds", "1.png")
    (backgrounds / "0.png").symlink_to(images / "0.png")
    with pytest.raises(InputError, match=r"leaves the folder|at once"):
        Photos(PhotoFolder(images), PhotoFolder(backgrounds, is_closed=True)).pairs(["0.png"])


def test_names_that_lead_away_find_the_photo_that_is_meant(tmp_path: Path):
    images = filled(tmp_path / "scene/images", "0.png")
    other = filled(tmp_path / "other", "0.png")
    backgrounds = PhotoFolder(filled(tmp_path / "scene/backgrounds", "0.png"))
    photos = Photos(PhotoFolder(images), backgrounds, beside=(tmp_path / "scene",))
    assert photos.image_of("0.png") == images / "0.png"
    for name in ("../other/0.png", str(other / "0.png"), "..\\other\\0.png"):
        found = photos.image_of(name)
        assert found is not None
        assert found.resolve() == other / "0.png"
    assert Photos(PhotoFolder(images), backgrounds).image_of("../other/0.png") == images / "0.png"


def test_backgrounds_in_folders_are_no_strangers(rig: Photos, caplog: pytest.LogCaptureFixture):
    with caplog.at_level(logging.WARNING):
        rig.tell_of_strangers(NAMES)
        assert not caplog.text
        rig.tell_of_strangers(NAMES[:3])
    assert "no pose is known for cam1/1.png; left out" in caplog.text
