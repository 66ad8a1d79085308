"""Shards: the records come back, files stay small, and a flipped bit is an error that names the file."""

from __future__ import annotations

import contextlib
import pickle
import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from record_strategies import assert_same, records, records_without_photos

from neugrasp.data.packing import pack
from neugrasp.data.records import Record, write_record
from neugrasp.data.shards import Shards
from neugrasp.errors import InputError

FEW = settings(max_examples=6, deadline=None, suppress_health_check=[HealthCheck.too_slow])


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six records on disk; those of a pair share their backgrounds."""
    folder = tmp_path_factory.mktemp("records")
    found: list[Record] = []

    @settings(max_examples=6, derandomize=True, database=None, deadline=None)
    @given(records())
    def keep(example: Record) -> None:
        found.append(example)

    keep()
    for number, record in enumerate(found[:6]):
        pair = found[number // 2 * 2]
        shared = replace(pair, name=f"scene-{number}", scene=record.scene) if number % 2 else record
        write_record(folder / f"scene-{number}", replace(shared, name=f"scene-{number}"))
    return folder


@pytest.fixture(scope="module")
def packed(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The records of `source` in one shard."""
    folder = tmp_path_factory.mktemp("packed")
    pack([source], folder)
    return folder


@pytest.mark.slow
@FEW
@given(st.lists(records() | records_without_photos(), min_size=1, max_size=3))
def test_records_come_back_from_shards_as_they_were(examples: list[Record]) -> None:
    with TemporaryDirectory() as folder:
        named = [replace(record, name=f"r{i}") for i, record in enumerate(examples)]
        for record in named:
            write_record(Path(folder) / "scenes" / record.name, record)
        pack([Path(folder) / "scenes"], Path(folder) / "packed")
        shards = Shards(Path(folder) / "packed")
        assert shards.names == tuple(record.name for record in named)
        for got, record in zip(shards, named, strict=True):
            assert_same(got, record)


@pytest.mark.slow
def test_shards_keep_to_their_limit_and_lose_nothing(source: Path, tmp_path: Path) -> None:
    pack([source], tmp_path / "one")
    limit = (tmp_path / "one" / "shard_0000.zip").stat().st_size // 2
    pack([source], tmp_path / "many", limit=limit)
    files = sorted((tmp_path / "many").glob("*.zip"))
    assert len(files) >= 2
    assert all(file.stat().st_size <= limit for file in files)
    one, many = Shards(tmp_path / "one"), Shards(tmp_path / "many")
    assert len(one) == len(many) == len(list(source.iterdir()))
    for a, b in zip(one, many, strict=True):
        assert_same(a, b)


@pytest.mark.slow
def test_packing_twice_gives_the_same_bytes_and_removes_what_is_stale(source: Path, tmp_path: Path) -> None:
    for name in ("a", "b"):
        pack([source], tmp_path / name, limit=200_000)
    assert len(list((tmp_path / "a").iterdir())) > 2
    pack([source], tmp_path / "a")
    pack([source], tmp_path / "b")
    contents = [{p.name: p.read_bytes() for p in (tmp_path / name).iterdir()} for name in ("a", "b")]
    assert contents[0] == contents[1]
    assert sorted(contents[0]) == ["index.json", "shard_0000.zip"]


def test_a_shared_background_is_stored_once(source: Path, tmp_path: Path) -> None:
    for number in (0, 1):
        target = tmp_path / "pair" / f"scene-{number}"
        target.parent.mkdir(exist_ok=True)
        target.symlink_to(source / f"scene-{number}")
    single = tmp_path / "single" / "scene-0"
    single.parent.mkdir()
    single.symlink_to(source / "scene-0")
    pack([tmp_path / "pair"], tmp_path / "two")
    pack([tmp_path / "single"], tmp_path / "one")
    sizes = [(tmp_path / name / "shard_0000.zip").stat().st_size for name in ("one", "two")]
    images = Shards(tmp_path / "one")[0].images.nbytes
    assert sizes[1] < 2 * sizes[0] - images // 2


@pytest.mark.slow
def test_access_is_random_and_survives_a_pickle(source: Path, tmp_path: Path) -> None:
    pack([source], tmp_path)
    shards = pickle.loads(pickle.dumps(Shards(tmp_path)))
    assert [record.name for record in shards[1:3]] == ["scene-1", "scene-2"]
    assert shards[-1].name == shards.names[-1]
    with pytest.raises(IndexError):
        shards[len(shards)]


@pytest.mark.slow
@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(position=st.floats(0, 1), bit=st.integers(0, 7))
def test_a_flipped_bit_is_an_error_or_harmless(
    position: float, bit: int, packed: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("flipped")
    for file in packed.iterdir():
        shutil.copy(file, folder)
    path = folder / "shard_0000.zip"
    data = bytearray(path.read_bytes())
    data[int(position * (len(data) - 1))] ^= 1 << bit
    path.write_bytes(data)
    for index, record in enumerate(Shards(packed)):
        with contextlib.suppress(InputError):
            assert_same(Shards(folder)[index], record)


@pytest.mark.slow
@pytest.mark.parametrize("damage", ["missing", "cut", "garbage"])
def test_a_damaged_shard_is_named_with_what_to_do(damage: str, source: Path, tmp_path: Path) -> None:
    pack([source], tmp_path)
    path = tmp_path / "shard_0000.zip"
    if damage == "missing":
        path.unlink()
    elif damage == "cut":
        path.write_bytes(path.read_bytes()[:1000])
    else:
        path.write_bytes(np.random.default_rng(0).bytes(5000))
    with pytest.raises(InputError, match=r"pack (it|the records) again") as caught:
        Shards(tmp_path)[0]
    assert str(path) in str(caught.value)


SHARD_ELSEWHERE = '{{"format": "neugrasp-shards", "version": 1, "records": [{{"name": "a", "shard": "{}"}}]}}'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("{", "not valid JSON"),
        ('{"format": "other"}', "format is 'other'; it must be 'neugrasp-shards'"),
        ('{"format": "neugrasp-shards", "version": 2, "records": []}', "version is 2; .* reads version 1"),
        ("[]", "not a JSON object"),
        ('{"format": "neugrasp-shards", "version": true, "records": []}', "version is True"),
        ('{"format": "neugrasp-shards", "version": 1, "records": {}}', "records is {}; it must be a list"),
        ('{"format": "neugrasp-shards", "version": 1, "records": [{"name": 1}]}', "name is 1"),
        (SHARD_ELSEWHERE.format("../../elsewhere/shard_0000.zip"), "beside the index"),
        (SHARD_ELSEWHERE.format("/tmp/shard_0000.zip"), "beside the index"),
        (SHARD_ELSEWHERE.format("shard_0000.zip/../../x"), "beside the index"),
        ("[" * 100_000, "too deep"),
    ],
)
def test_a_damaged_index_is_named(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "index.json").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        Shards(tmp_path)
    assert "index.json" in str(caught.value)


def test_nothing_to_pack_and_doubled_names_are_errors(source: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no records"):
        pack([tmp_path], tmp_path / "out")
    with pytest.raises(InputError, match="names must differ"):
        pack([source, source], tmp_path / "out")
    with pytest.raises(InputError, match="missing"):
        Shards(tmp_path / "absent")
