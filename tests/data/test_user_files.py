"""Files of users: regular ones only, and of JSON only what every reader understands alike."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from neugrasp.data.strict_json import DEEPEST, LARGEST, parse_json, read_json, read_object
from neugrasp.data.user_files import read_text
from neugrasp.errors import InputError


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.json"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('{"a": 1, "b": {"c": 1, "c": 2}}', "the key 'c' is given twice"),
        ('{"version": 99, "version": 1}', "the key 'version' is given twice"),
        ('{"a": ' + "1" * 5001 + "}", "a number of 5001 digits"),
        ('{"a": -' + "1" * 31 + "}", "a number of 32 digits"),
        ('{"a": ' + "[" * DEEPEST + "]" * DEEPEST + "}", "deep in each other"),
        ('{"a": ' + "[" * 100_000 + "]" * 100_000 + "}", "deep in each other"),
        ('{"a": ' + '{"b":' * DEEPEST + "1" + "}" * (DEEPEST + 1), "deep in each other"),
        ('{"a": "\\ud800"}', "holds half a character"),
        ('{"\\udc00": 1}', "holds half a character"),
        ("[1]", "not a scene; it must be an object in braces"),
        ("", "not valid JSON"),
        ('{"a": 1,}', "not valid JSON"),
    ],
)
def test_what_json_readers_differ_about_is_refused(file: Path, text: str, message: str):
    file.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_object(file, "a scene")
    assert str(caught.value).startswith(f"{file}: ")
    assert len(str(caught.value).splitlines()) == 1


def test_whole_characters_nesting_and_numbers_of_usual_size_are_read(file: Path):
    data = {"ä": "😀 日本", "deep": [[[[[[1.5, None, True, -(10**20)]]]]]]}
    file.write_text(json.dumps(data))
    assert read_object(file, "a scene") == data


def test_the_mark_of_byte_order_is_no_part_of_the_text(file: Path):
    file.write_bytes(b"\xef\xbb\xbf" + b'{"a": 1}')
    assert read_object(file, "a scene") == {"a": 1}
    assert read_text(file) == '{"a": 1}'


def test_other_encodings_are_named(file: Path):
    for encoding in ("utf-16", "latin-1"):
        file.write_bytes('{"a": "ä"}'.encode(encoding))
        with pytest.raises(InputError, match=r"no text in UTF-8 .*; save it as UTF-8"):
            read_object(file, "a scene")


@pytest.mark.timeout(20)
def test_pipes_devices_and_folders_are_not_opened(file: Path, tmp_path: Path):
    os.mkfifo(file)
    for odd, what in (
        (file, "a pipe"),
        (tmp_path, "a folder"),
        (Path("/dev/zero"), "a pipe, a socket or a device"),
    ):
        with pytest.raises(InputError, match=f"is {what}.*; only regular files are read"):
            read_object(odd, "a scene")


def test_a_missing_file_and_one_without_end_are_named(file: Path, tmp_path: Path):
    with pytest.raises(InputError, match=r"a\.json: missing; a scene is needed"):
        read_object(file, "a scene")
    (tmp_path / "b.json").symlink_to(tmp_path / "b.json")
    with pytest.raises(InputError, match=r"b\.json: (cannot be read|missing)"):
        read_object(tmp_path / "b.json", "a scene")
    with file.open("wb") as stream:
        stream.truncate(LARGEST + 1)
    with pytest.raises(InputError, match="64 MiB; at most 64 are read"):
        read_object(file, "a scene")


@pytest.mark.parametrize("number", ["NaN", "-Infinity", "1e999"])
def test_captures_are_judged_field_by_field_and_other_files_as_a_whole(file: Path, number: str):
    """What is wrong with a view of a capture is told with the view's number, by who reads it."""
    file.write_text(f'{{"a": {number}, "b": "\\u0007"}}')
    found = read_object(file, "a scene")
    assert not abs(found["a"]) < float("inf")
    assert found["b"] == "\a"
    for read in (lambda: read_json(file, "a gripper"), lambda: parse_json(file.read_text(), str(file))):
        with pytest.raises(InputError, match="not a finite number"):
            read()
