"""How near the depth of RGBGrasp-GT's radiance field comes to the given one, over seconds.

    python benchmarks/nerf_curve.py RECORD [RECORD ...] [--rays 256 512 1024] [--steps 300] [--device cpu]

RECORD is a folder of a scene that `neugrasp generate` made. For each number of rays one line every so many
steps: seconds of fitting so far and those of the processor, the median error of the rendered depth and the
share of pixels that miss by more than 5 mm, of some thousand pixels that have depth.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import replace
from pathlib import Path

import torch

from neugrasp.baselines.nerf.field import RadianceField
from neugrasp.baselines.nerf.fit import FitConfig, Pixels, fitted, pixels_of
from neugrasp.data.records import read_record
from neugrasp.observation import Observation

LOOKED_AT = 4096
"""Pixels on which the error is taken."""


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("records", nargs="+", type=Path)
    options.add_argument("--rays", nargs="+", type=int, default=[256, 512, 1024])
    options.add_argument("--steps", type=int, default=FitConfig().steps)
    options.add_argument("--every", type=int, default=50)
    options.add_argument("--device", default="cpu")
    given = options.parse_args()
    print(f"{'scene':<24} {'rays':>6} {'step':>6} {'seconds':>8} {'processor':>10} {'mm':>10} {'> 5 mm':>8}")
    for folder in given.records:
        pixels, workspace = _seen(folder)
        chosen = torch.randperm(len(pixels), generator=torch.Generator().manual_seed(1))[:LOOKED_AT]
        for rays in given.rays:
            config = replace(FitConfig(), rays=rays, steps=given.steps, max_error=10.0)
            curve = Curve(folder.name, rays, given.every, pixels.select(chosen))
            fitted(pixels, workspace, config, torch.device(given.device), 0, curve)


def _seen(folder: Path) -> tuple[Pixels, object]:
    record = read_record(folder, "inputs", trials=False)
    frames = tuple(
        replace(view, depth=depth) for view, depth in zip(record.views().frames, record.depths, strict=True)
    )
    return pixels_of(Observation(frames, record.workspace)), record.workspace


class Curve:
    """Prints the error from time to time; looking at it does not count."""

    def __init__(self, name: str, rays: int, every: int, looked_at: Pixels):
        self.name, self.rays, self.every = name, rays, every
        self.known = looked_at.select(torch.nonzero(looked_at.depths > 0).squeeze(1))
        self.spent = (0.0, 0.0)
        self.since = _clocks()

    @torch.no_grad()
    def __call__(self, step: int, field: RadianceField) -> None:
        now = _clocks()
        self.spent = tuple(a + b - c for a, b, c in zip(self.spent, now, self.since, strict=True))
        if (step + 1) % self.every == 0:
            last = field(self.known.rays)[1][-1]
            error = 1000 * (last.depth - self.known.depths).abs()
            print(
                f"{self.name:<24} {self.rays:>6} {step + 1:>6} {self.spent[0]:>8.1f} {self.spent[1]:>10.1f} "
                f"{float(error.median()):>10.2f} {100 * float((error > 5).float().mean()):>7.1f}%",
                flush=True,
            )
        self.since = _clocks()


def _clocks() -> tuple[float, float]:
    return time.perf_counter(), time.process_time()


if __name__ == "__main__":
    main()
