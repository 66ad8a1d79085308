"""What the data sheet says of scenes that are known."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

import data_sheet
from data_sheet import Counts
from neugrasp.data import records
from neugrasp.data.labels import GraspLabels
from neugrasp.data.records import Record, write_record

DOWN, SIDEWAYS = (1.0, 0.0, 0.0, 0.0), (0.0, np.sqrt(0.5), 0.0, np.sqrt(0.5))


def labelled(record: Record, *trials: tuple[tuple[float, ...], float, bool]) -> Record:
    quaternions, widths, success = zip(*trials, strict=True)
    count = len(trials)
    points = np.full((count, 3), 0.15, np.float32)
    return replace(
        record,
        labels=GraspLabels(
            points, np.array(quaternions, np.float32), np.array(widths, np.float32), np.array(success)
        ),
    )


@pytest.fixture
def scenes(make_record) -> list[Record]:
    """A photographed ball with three successes of four, and one that nobody photographed without any."""
    first = labelled(
        make_record(x=0.15, y=0.15, seed=1),
        (DOWN, 0.03, True),
        (DOWN, 0.05, True),
        (SIDEWAYS, 0.04, True),
        (DOWN, 0.08, False),
    )
    masks = np.zeros_like(first.masks)
    masks[0, 2:5, 3:8] = 1
    first = replace(first, masks=masks)
    second = labelled(make_record(x=0.1, y=0.2, seed=2), (DOWN, 0.08, False))
    return [first, replace(second, cell={"photos": False}, **records.without_photos())]


def test_counts_of_known_scenes(scenes: list[Record]):
    counts = Counts()
    for record in scenes:
        counts.add(record)
    assert (counts.scenes, counts.with_photos, counts.trials) == (2, 1, 5)
    assert counts.positives == [3, 0]
    assert counts.photos == len(scenes[0].images) + len(scenes[0].targets)
    assert sum(counts.materials.values()) == counts.objects == 2
    np.testing.assert_allclose(sorted(counts.angles), [0, 0, 90], atol=0.1)
    np.testing.assert_allclose(sorted(counts.widths), [0.03, 0.04, 0.05], atol=1e-6)
    assert counts.pixels == {"all": scenes[0].masks.size, "object": 15}
    # A ball fills little of the cube, whatever is observed of either.
    assert 0 < counts.voxels["inside"] < 0.05 * counts.voxels["all"]


def test_the_command_writes_a_page_with_a_column_for_every_folder(
    tmp_path: Path, scenes: list[Record], capsys: pytest.CaptureFixture[str]
):
    for record, folder in zip(scenes, ("one", "two"), strict=True):
        write_record(tmp_path / folder / "scenes" / record.name, record)
    out = tmp_path / "sheet"
    arguments = ["--data", str(tmp_path / "one"), str(tmp_path / "two"), "--out", str(out)]
    assert data_sheet.main(arguments) == 0
    assert capsys.readouterr().out.splitlines()[0] == str(out / "data_sheet.md")
    page = (out / "data_sheet.md").read_text()
    assert "2 scenes, 1 of them with photos." in page
    assert "| | one | two |" in page
    assert "| of them successful | 75.0 % | 0.0 % |" in page
    assert "| scenes without any | 0 | 1 |" in page
    assert "| 66.7 %, 0.0 %, 33.3 % | -, -, - |" in page.replace("down, between, beyond 60 deg ", "")
    for name in ("scenes.jpg", "balance.png"):
        assert f"]({name})" in page
        with Picture.open(out / name) as picture:
            assert min(picture.size) > 100


def test_a_folder_without_records_leaves_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]):
    (tmp_path / "empty").mkdir()
    out = tmp_path / "sheet"
    assert data_sheet.main(["--data", str(tmp_path / "empty"), "--out", str(out)]) == 2
    assert "no scenes" in capsys.readouterr().err
    assert not out.exists()
