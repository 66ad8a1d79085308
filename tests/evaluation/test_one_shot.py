"""Validation on held-out records: what is counted, and what happens after an interruption."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from neugrasp import cli
from neugrasp.data import records
from neugrasp.data.records import Record, read_record, write_record
from neugrasp.errors import InputError
from neugrasp.evaluation import one_shot
from neugrasp.evaluation.commands import OneShot
from neugrasp.evaluation.one_shot import DETECTORS, run_one_shot
from neugrasp.geometry.workspace import Workspace
from neugrasp.metrics import L1_MASKS, l1_by_mask, wilson_interval
from neugrasp.model.checkpoint import save_checkpoint
from neugrasp.model.network import NeuGrasp
from neugrasp.simulation.arrange import arrange
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.materials import sample_materials
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.training.recipes import tiny

KINDS = ("single", "packed", "single")
MIXES = ("transparent", "diffuse", "specular")


@pytest.fixture(scope="module", autouse=True)
def _cache(tmp_path_factory: pytest.TempPathFactory) -> object:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NEUGRASP_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield


@pytest.fixture(scope="module")
def weights(tmp_path_factory: pytest.TempPathFactory) -> str:
    """A network that knows nothing but how wide to open."""
    return write_weights(tmp_path_factory.mktemp("weights") / "random.safetensors", seed=0)


def write_weights(path: Path, seed: int) -> str:
    torch.manual_seed(seed)
    model = NeuGrasp(tiny().model)
    torch.nn.init.constant_(model.head.width.bias, 6.0)
    save_checkpoint(path, model, {})
    return str(path)


def test_scenes_without_photos_are_named(tmp_path: Path, weights: str):
    from ball_record import ball_record

    for name, has_photos in (("ball-0", True), ("ball-1", False)):
        record = replace(ball_record(size=32), name=name)
        if not has_photos:
            record = replace(record, cell={"photos": False}, **records.without_photos())
        write_record(tmp_path / "scenes" / name, record)
    with pytest.raises(InputError, match="1 of 2 scenes have no photos, ball-1 among them"):
        run_one_shot(OneShot(data=(tmp_path,), out=tmp_path / "out", weights=weights))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three scenes of glassware; the photos show something else, which a random network does not mind."""
    from ball_record import ball_record

    folder = tmp_path_factory.mktemp("data")
    library = ObjectLibrary.open(("glassware",))
    with World(Workspace(), library) as world:
        for seed, (kind, mix) in enumerate(zip(KINDS, MIXES, strict=True)):
            scene = arrange(kind, seed + 3, world, library.choices("test", kind), num_objects=2)
            scene = sample_materials(scene, mix, np.random.default_rng(seed))
            world.reset(scene)
            truth = scan(world, Workspace())
            record = replace(
                ball_record(seed=seed),
                name=f"{kind}-{seed}",
                scene=scene,
                tsdf=truth.values,
                observed=truth.observed,
            )
            write_record(folder / "scenes" / record.name, record)
    return folder


@pytest.fixture(scope="module")
def run(data: Path, weights: str, tmp_path_factory: pytest.TempPathFactory) -> OneShot:
    """With a threshold so low that even a random network grasps somewhere."""
    out = tmp_path_factory.mktemp("out")
    return OneShot(data=(data,), out=out, weights=weights, threshold=0.01, hand_check=False)


@pytest.fixture(scope="module")
def summary(run: OneShot) -> dict[str, Any]:
    return run_one_shot(run)


def attempts_in(out: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in (out / "attempts.jsonl").read_text().splitlines()]


@pytest.mark.slow
def test_every_record_is_tried_once_by_every_detector(run: OneShot, summary: dict[str, Any]) -> None:
    attempts = attempts_in(run.out)
    tried = [(attempt["record"], attempt["detector"]) for attempt in attempts]
    names = [f"{kind}-{seed}" for seed, kind in enumerate(KINDS)]
    assert sorted(tried) == sorted((name, detector) for name in names for detector in DETECTORS)
    assert all(attempt["num_grasps"] > 0 for attempt in attempts if attempt["detector"] != "antipodal")
    for attempt in attempts:
        assert attempt["success"] == (attempt["reason"] == "success")
        assert (attempt["num_grasps"] == 0) == (attempt["reason"] == "nothing detected")


@pytest.mark.slow
def test_the_summary_counts_what_was_tried(run: OneShot, summary: dict[str, Any]) -> None:
    attempts = attempts_in(run.out)
    assert set(summary["success"]) == {f"{kind}/{d}" for kind in KINDS for d in DETECTORS}
    for name, row in summary["success"].items():
        group = [a for a in attempts if f"{a['kind']}/{a['detector']}" == name]
        successes = sum(attempt["success"] for attempt in group)
        assert (row["attempts"], row["successes"]) == (len(group), successes)
        assert row["rate"] == pytest.approx(100 * successes / len(group), abs=0.06)
        assert row["ci"] == pytest.approx(
            [100 * edge for edge in wilson_interval(successes, len(group))], abs=0.06
        )
        assert sum(row["reasons"].values()) == len(group)
    assert json.loads((run.out / "held_out.json").read_text()) == summary


def test_surfaces_are_judged_by_material(run: OneShot, summary: dict[str, Any], data: Path) -> None:
    assert set(summary["by_material"]) == {"diffuse", "transparent-specular"}
    record = read_record(data / "scenes" / "packed-1")
    scores = summary["by_material"]["diffuse"]
    assert scores["records"] == 1
    for mask in L1_MASKS:
        for constant in (-1.0, 0.0, 1.0):
            expected = l1_by_mask(constant, record.tsdf)[str(mask)]
            assert scores[f"l1_{mask}_constant_{constant:+.0f}"] == pytest.approx(expected)
    assert {"l1_0.3", "iou", "psnr", "ssim", "grasp_auc"} <= set(scores)


@pytest.mark.slow
@pytest.mark.parametrize("keep", [0, 1, 4, 7])
def test_a_run_goes_on_where_its_file_was_cut(
    keep: int,
    run: OneShot,
    summary: dict[str, Any],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Cut in the middle of line `keep`; whole records before it are not tried again."""
    out = tmp_path / "out"
    shutil.copytree(run.out, out)
    lines = (run.out / "attempts.jsonl").read_text().splitlines(keepends=True)
    (out / "attempts.jsonl").write_text("".join(lines[:keep]) + lines[keep][:25])
    tried: list[str] = []
    real = one_shot.attempts_of

    def counted(record: Record, *rest: Any) -> Any:
        tried.append(record.name)
        return real(record, *rest)

    monkeypatch.setattr(one_shot, "attempts_of", counted)
    monkeypatch.setattr(one_shot, "validate", lambda *_: {})
    run_one_shot(replace(run, out=out))
    assert (out / "attempts.jsonl").read_text() == "".join(lines)
    assert len(tried) == len(KINDS) - keep // len(DETECTORS)


def test_attempts_of_two_networks_are_never_mixed(
    run: OneShot, summary: dict[str, Any], tmp_path: Path
) -> None:
    before = (run.out / "attempts.jsonl").read_bytes()
    other = write_weights(tmp_path / "other.safetensors", seed=1)
    for changed, named in (
        (replace(run, weights=other), "weights"),
        (replace(run, threshold=0.5), "threshold"),
    ):
        with pytest.raises(InputError, match=f"made with {named}.*another --out"):
            run_one_shot(changed)
    assert (run.out / "attempts.jsonl").read_bytes() == before


def test_records_of_one_name_are_refused(run: OneShot, data: Path, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="'packed-1' is in two of the folders"):
        run_one_shot(replace(run, data=(data, data), out=tmp_path))


@pytest.mark.slow
def test_labels_that_all_failed_have_no_auc(
    make_record: Callable[..., Record], run: OneShot, data: Path, tmp_path: Path
) -> None:
    record = read_record(data / "scenes" / "single-0")
    failed = replace(record.labels, success=np.zeros_like(record.labels.success))
    write_record(tmp_path / "data" / "failed", replace(record, name="failed", labels=failed))
    out = tmp_path / "out"
    run_one_shot(replace(run, data=(tmp_path / "data",), out=out))
    text = (out / "held_out.json").read_text()
    assert "NaN" not in text
    assert json.loads(text)["by_material"]["transparent-specular"]["grasp_auc"] is None


@pytest.mark.slow
def test_the_program_prints_it_as_a_table(
    run: OneShot, summary: dict[str, Any], data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["one-shot", "--data", str(data), "--out", str(run.out), "--weights", run.weights]
    assert cli.main([*arguments, "--threshold", "0.01", "--no-hand-check"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for name, row in summary["success"].items():
        (line,) = [line for line in lines if line.startswith(name + " ")]
        assert f"{row['rate']:.1f} %" in line
        assert f"{row['ci'][0]:.1f} to {row['ci'][1]:.1f} %" in line
        assert all(f"{count} {reason}" in line for reason, count in row["reasons"].items())
    for material, scores in summary["by_material"].items():
        (at,) = [i for i, line in enumerate(lines) if line.startswith(material + " ")]
        assert f"{scores['l1_0.3']:.3f}" in lines[at]
        assert f"{scores['l1_0.05_constant_+1']:.3f}" in lines[at + 3]
    assert lines[-2].endswith("held_out.json")
