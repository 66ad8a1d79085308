"""Scenes in an object store: the same files as in a folder, whatever fails on the way."""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from neugrasp.bucket import Bucket, is_url, local_of
from neugrasp.data.labels import LABELS_FILE
from neugrasp.data.records import read_record
from neugrasp.data.scene_sets import SceneFolder
from neugrasp.errors import InputError, WriteError
from neugrasp.simulation.command import Generate
from neugrasp.simulation.generate import generate, run

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("fsspec") is None or importlib.util.find_spec("pybullet") is None,
    reason="fsspec or pybullet is not installed",
)


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEUGRASP_CACHE", str(tmp_path_factory.mktemp("cache")))
        patch.syspath_prepend(str(Path(__file__).parent))
        yield


@pytest.fixture
def store() -> Iterator[Any]:
    """The object store of this process, empty."""
    files = importlib.import_module("fsspec").filesystem("memory")
    files.store.clear()
    yield files
    files.store.clear()


def small(out: Path | str, **changes: Any) -> Generate:
    given = {"scene": "packed", "num": 3, "object_sets": ("glassware",), "grasp_points": 2, "workers": 1}
    return Generate(out=Path(out), **{**given, "scenes_per_cell": 2, "image_size": 32, "seed": 4, **changes})


def made(config: Generate) -> list[Path]:
    return generate(config, importlib.import_module("noise_renderer").NoiseRenderer)


def in_folder(out: Path) -> dict[str, bytes]:
    files = (file for file in out.rglob("*") if file.is_file() and file.parts[len(out.parts)] != "cells")
    names = ((file, str(file.relative_to(out))) for file in files)
    return {name: file.read_bytes() for file, name in names if name[0] != "." and name != "timing.json"}


def in_store(files: Any, root: str) -> dict[str, bytes]:
    names = ((place, place.removeprefix(f"{root}/")) for place in files.find(root))
    return {name: files.cat_file(place) for place, name in names if name != "timing.json"}


@pytest.fixture(scope="module")
def folder(_cache: None, tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    out = tmp_path_factory.mktemp("plain") / "out"
    made(small(out))
    return in_folder(out)


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_the_same_files_as_in_a_folder(folder: dict[str, bytes], store: Any, tmp_path: Path, workers: int):
    made(small("memory://lab/packed", workers=workers))
    found = in_store(store, "/lab/packed")
    assert found == folder
    assert len([name for name in found if name.endswith(LABELS_FILE)]) == 3
    for name, content in found.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    assert len(SceneFolder(tmp_path)) == 3
    assert read_record(tmp_path / "scenes/packed-4-000002").has_photos


@pytest.mark.slow
def test_what_fails_in_the_middle_goes_on_where_it_stopped(
    folder: dict[str, bytes], store: Any, monkeypatch: pytest.MonkeyPatch
):
    put, left = type(store).pipe_file, [len(folder) // 2]

    def refuses(self: Any, *given: Any, **options: Any) -> Any:
        if left[0] == 0:
            raise PermissionError("the token has expired")
        left[0] -= 1
        return put(self, *given, **options)

    with monkeypatch.context() as patch:
        patch.setattr(type(store), "pipe_file", refuses)
        with pytest.raises(
            WriteError, match=r"^memory://lab/packed: cannot be written \(the token has expired"
        ):
            made(small("memory://lab/packed"))
    half = in_store(store, "/lab/packed")
    assert 0 < len(half) < len(folder)
    # A scene counts from its last file on, and that one has all the others beside it.
    for name in half:
        if name.endswith(LABELS_FILE):
            beside = {other for other in folder if Path(other).parent == Path(name).parent}
            assert beside <= set(half)
    first = next(iter(store.find("/lab/packed/scenes")))
    begun = store.created(first)
    made(small("memory://lab/packed"))
    assert in_store(store, "/lab/packed") == folder
    assert store.created(first) == begun


@pytest.mark.slow
def test_another_data_set_is_not_mixed_in(store: Any):
    config = small("memory://lab/packed", num=1, photos=False)
    generate(config)
    with pytest.raises(InputError, match=r"memory://lab/packed/dataset.json: .* made with seed = 4, not 5"):
        generate(small("memory://lab/packed", num=1, photos=False, seed=5))
    assert run(config) == "1 scenes in memory://lab/packed; copy it into a folder to learn from it"


@pytest.mark.slow
def test_a_url_of_this_machine_is_a_folder(tmp_path: Path):
    (scene,) = generate(small(f"file://{tmp_path}/out", num=1, photos=False))
    assert scene == tmp_path / "out/scenes/packed-4-000000"
    assert (scene / LABELS_FILE).is_file()


def test_what_is_a_url():
    assert [is_url(Path(one)) for one in ("s3://bucket/x", "gs://b", "memory://x")] == [True] * 3
    assert not any(is_url(Path(one)) for one in ("out", "/out", "a:b", "C:/out", "file:///out"))
    assert local_of(Path("file:///shared/x")) == Path("/shared/x")
    with pytest.raises(InputError, match=r"^nowhere://x: cannot be opened \("):
        Bucket.open(Path("nowhere://x"))
    with pytest.raises(InputError, match="is in an object store; copy it into a folder"):
        SceneFolder(Path("s3://bucket/packed"))
