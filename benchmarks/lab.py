"""NeuGrasp-RA in a lab that is simulated (the paper's second table): what it gains, and from how many scenes.

    python benchmarks/lab.py --out FOLDER [--parts collect rows adapt held rows table] [--scenes 10 20 40]
        [--seed 1]

`collect` makes the set (objects of training), and ten scenes more that nothing learns from. `adapt` goes on
with the shipped weights on so many of its scenes. `rows` plays piles and packed scenes of the test's
objects: the shipped weights in the domain of training and in the lab, and there GraspNeRF with TSDF and all
that was adapted, too. The lab was made as hard as it is by four rounds of seed 0, so rows play those of
another. `held` judges grasps in the ten scenes. `table` prints everything that is there, and writes it to
table.md. Parts run in the order given; each goes on where it stopped, and what is finished is not done again.
Seconds are those of the wall, summed over starts.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from functools import cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.scene_sets import open_scenes
from neugrasp.evaluation.compare import compare
from neugrasp.evaluation.results_io import played
from neugrasp.evaluation.tables import rate_cell
from neugrasp.model.checkpoint import load_checkpoint
from neugrasp.output import write_text
from neugrasp.training.dataset import Scenes
from neugrasp.training.recipes import adapt
from neugrasp.training.validation import validate

PARTS = ("collect", "rows", "adapt", "held", "table")
USUAL = ("collect", "rows", "adapt", "held", "rows", "table")
THRESHOLD = 0.85
"""That of the shipped weights, for what was adapted from them, too."""
GRASPNERF = "graspnerf-tsdf"
SHIPPED = ("neugrasp", GRASPNERF)
KINDS = ("pile", "packed")
ASIDE = 10
"""Scenes of other seeds in which grasps are judged."""
RESAMPLES = 10_000
PAPER = {
    "GraspNeRF with TSDF": {"pile": "38.9 / 40.0 / 22.4", "packed": "46.7 / 64.0 / 33.6"},
    "NeuGrasp": {"pile": "63.7 / 68.0 / 57.6", "packed": "84.1 / 92.0 / 84.8"},
    "NeuGrasp-RA": {"pile": "84.5 / 92.0 / 96.0", "packed": "85.8 / 88.0 / 96.8"},
}
"""SR / FSR / DR of the paper's table II, on a real table."""


class Lab:
    """The folders of the experiment, and the commands that fill them."""

    def __init__(self, options: argparse.Namespace):
        self.options, self.out = options, Path(options.out)

    def collect(self) -> None:
        """The set, and the scenes aside."""
        tries = ["--no-hand-check"]
        for folder, count, seed in (("set", max(self.options.scenes), 0), ("aside", ASIDE, 1)):
            self._run("collect", folder, "--scenes", count, "--seed", seed, *tries, *self._quality())

    def adapt(self) -> None:
        """One training for each number of scenes."""
        for count in self.options.scenes:
            folder = self.out / f"ra{count}"
            more = ["--resume"] if (folder / "weights.safetensors").exists() else []
            course = ["--recipe", "adapt", "--init", "neugrasp", "--data", self.out / "set"]
            course += ["--loaders", 0, *self.options.train]
            self._run("train", f"ra{count}", *course, "--scenes", count, *more)

    def rows(self) -> None:
        """Every row that can be played, the shipped weights first."""
        for name, domain, weights in self.played_rows():
            if weights not in SHIPPED and not Path(weights).is_file():
                continue
            for kind in KINDS:
                which = ["--detector", name] if weights == name else ["--weights", weights]
                row = ["--scene", kind, "--domain", domain, *which, "--threshold", THRESHOLD]
                rules = ["--materials", "mixed", "--strategy", "random", "--rounds", self.options.rounds]
                more = ["--seed", self.options.seed, "--workers", 1, *self._quality()]
                self._run("evaluate", f"{name}-{kind}", *row, *rules, *more)

    def played_rows(self) -> list[tuple[str, str, str]]:
        """Name, domain and weights of each."""
        adapted = [
            (f"ra{count}", "lab", str(self.out / f"ra{count}/weights.safetensors"))
            for count in self.options.scenes
        ]
        shipped = [("lab", "lab", "neugrasp"), ("training", "training", "neugrasp")]
        return [*shipped, (GRASPNERF, "lab", GRASPNERF), *adapted]

    def held(self) -> None:
        """Grasps in the scenes aside: loss and AUC, of each weights that are there."""
        scenes = open_scenes(self.out / "aside")
        aside = Scenes(
            [(scenes, i) for i in range(len(scenes))], adapt().model.image_size, finds_changes=False
        )
        samples = [aside.sample(index, None) for index in range(len(aside))]
        found = {}
        for name, _, weights in self.played_rows():
            if name not in ("training", GRASPNERF) and (weights in SHIPPED or Path(weights).is_file()):
                model = load_checkpoint(weights).model()
                found[name] = validate(model, samples, adapt().sharpness[1], render=False)
        (self.out / "held.json").write_text(json.dumps(found, indent=1) + "\n")

    def table(self) -> None:
        """Prints what is there, and writes it to table.md."""
        text = "\n".join(
            [*self._rates(), "", *self._differences(), "", *self._learning(), "", *self._origin()]
        )
        write_text(self.out / "table.md", text + "\n")
        print(text)

    def _rates(self) -> Iterator[str]:
        yield "| SR / FSR / DR | pile | packed |"
        yield "|---|---|---|"
        for name, per_kind in PAPER.items():
            yield f"| {name}, the paper's real table | {' | '.join(per_kind[kind] for kind in KINDS)} |"
        for name, domain, _ in self.played_rows():
            yield f"| {_title(name, domain)} | {' | '.join(self._told(name, kind) for kind in KINDS)} |"

    def _told(self, name: str, kind: str) -> str:
        if not (rows := self._played(kind, name)):
            done = len(list((self.out / f"{name}-{kind}" / "rounds").glob("[!.]*.json")))
            return f"{done} of {self.options.rounds} rounds"
        data = _metrics(rows[0])
        rates = " / ".join(rate_cell(data, rate) for rate in _RATES)
        return f"{rates}; {data['successes']} of {data['attempts']} grasps, {data['objects']} objects"

    def _differences(self) -> Iterator[str]:
        yield "| in points | pile: SR | pile: DR | packed: SR | packed: DR |"
        yield "|---|---|---|---|---|"
        yield self._row("lab less training, not paired: objects settle otherwise", self._gap)
        for name, domain, _ in self.played_rows():
            if domain == "lab" and name != "lab":
                yield self._row(
                    f"{_title(name, domain)} less NeuGrasp there, paired", partial(self._gain, name)
                )
        for count in self.options.scenes:
            yield self._row(
                f"of the gap, {_title(f'ra{count}', 'lab')} closes", partial(self._closed, f"ra{count}")
            )

    def _row(self, title: str, cell: Callable[[str, str], str]) -> str:
        return (
            f"| {title} | " + " | ".join(cell(kind, rate) for kind in KINDS for rate in ("SR", "DR")) + " |"
        )

    def _gap(self, kind: str, rate: str) -> str:
        if not (rows := self._played(kind, "training", "lab")):
            return ""
        rng, column, sides = np.random.default_rng(0), _COLUMN[rate], [_counts(row) for row in rows]
        drawn = [_rate(s[rng.integers(len(s), size=(RESAMPLES, len(s)))], column) for s in sides]
        ends = np.percentile(drawn[1] - drawn[0], [2.5, 97.5])
        return _points(_rate(sides[1], column) - _rate(sides[0], column), ends)

    def _gain(self, name: str, kind: str, rate: str) -> str:
        """The same rounds, paired."""
        if not (rows := self._played(kind, "lab", name)):
            return ""
        found = _compared(*rows)[rate]
        return _points(found["difference"], found["ci"])

    def _closed(self, name: str, kind: str, rate: str) -> str:
        if not (rows := self._played(kind, "training", "lab", name)):
            return ""
        training, lab, adapted = (_metrics(row)[rate] for row in rows)
        return f"{100 * (adapted - lab) / (training - lab):.0f} %" if training > lab else "there is none"

    def _learning(self) -> Iterator[str]:
        """What grasps in the scenes aside say, and how long everything took."""
        yield "| | loss of the grasps tried in ten other scenes | their AUC | minutes of learning |"
        yield "|---|---|---|---|"
        file = self.out / "held.json"
        held, seconds = json.loads(file.read_text()) if file.is_file() else {}, self._seconds()
        for name, scores in held.items():
            took = f"{seconds[name] / 60:.0f}" if name in seconds else ""
            told = " | ".join(f"{scores[score]:.3f}" for score in ("grasp_loss", "grasp_auc"))
            yield f"| {_title(name, 'lab')} | {told} | {took} |"

    def _origin(self) -> Iterator[str]:
        options = self.options
        rows = [self._played(kind, name) for name, _, _ in self.played_rows() for kind in KINDS]
        commits = {_metrics(row)["commit"] for found in rows for row in found}
        yield (
            f"`python benchmarks/lab.py --out FOLDER --seed {options.seed} --scenes "
            f"{' '.join(map(str, options.scenes))} --rounds {options.rounds}`, "
            f"commit {', '.join(sorted(commits))}"
        )

    def _played(self, kind: str, *names: str) -> list[Path]:
        """The folders of these rows; none where one of them is not finished."""
        rows = [self.out / f"{name}-{kind}" for name in names]
        return rows if all((row / "metrics.json").is_file() for row in rows) else []

    def _seconds(self) -> dict[str, float]:
        file = self.out / "seconds.json"
        found: dict[str, float] = json.loads(file.read_text()) if file.is_file() else {}
        return found

    def _quality(self) -> list[object]:
        return ["--samples", self.options.samples]

    def _run(self, command: str, folder: str, *words: object) -> None:
        """A command of the program, and how long it took."""
        out, began = self.out / folder, time.monotonic()
        done = out / "lab_done"
        if done.exists():
            return
        line = [sys.executable, "-m", "neugrasp", command, "--out", str(out), *map(str, words)]
        print(" ".join(line[2:]), flush=True)
        ended = subprocess.run(line, check=False)
        seconds = self._seconds()
        seconds[folder] = round(seconds.get(folder, 0) + time.monotonic() - began)
        write_text(self.out / "seconds.json", json.dumps(seconds, indent=1) + "\n")
        if ended.returncode:
            sys.exit(ended.returncode)
        done.touch()


_RATES = ("SR", "FSR", "DR")
_COLUMN = {"SR": 1, "DR": 2}


def _title(name: str, domain: str) -> str:
    """A row in words."""
    if name == GRASPNERF:
        return f"GraspNeRF with TSDF, {domain}"
    return f"NeuGrasp-RA, {name[2:]} scenes" if name.startswith("ra") else f"NeuGrasp, {domain}"


def _points(difference: float, ends: Sequence[float]) -> str:
    """With its 95 % interval."""
    low, high = ends
    return f"{difference:+.1f} ({low:+.1f} to {high:+.1f})"


_compared = cache(compare)
"""Each pair of rows is asked for two rates."""


def _metrics(row: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((row / "metrics.json").read_text())
    return found


def _counts(folder: Path) -> np.ndarray:
    """(rounds, 3): successes, attempts and objects of each round."""
    return np.array([(e.successes, len(e.attempts), e.objects) for e in played(folder)], dtype=float)


def _rate(counts: np.ndarray, column: int) -> np.ndarray:
    """Percentages of counts (..., rounds, 3)."""
    total = counts.sum(axis=-2)
    return 100 * total[..., 0] / np.maximum(total[..., column], 1)


def main(words: Sequence[str] | None = None) -> None:
    """Does the parts in their order."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=USUAL)
    parser.add_argument("--scenes", nargs="+", type=int, default=[10, 20, 40])
    parser.add_argument("--rounds", type=int, default=25)
    parser.add_argument("--seed", type=int, default=1, help="of the rounds")
    parser.add_argument("--samples", type=int, default=1, help="of a photo's pixel")
    parser.add_argument("--train", nargs="*", default=[], help="options of train besides, as steps=500")
    options = parser.parse_args(words)
    pairs = [word.split("=", 1) for word in options.train]
    options.train = [word for name, value in pairs for word in (f"--{name}", value)]
    lab = Lab(options)
    for part in options.parts:
        getattr(lab, part)()


if __name__ == "__main__":
    main()
