"""Where the processor time of a photo goes, and how far photos are from one with many samples.

    python benchmarks/photo_speed.py [--scenes 2] [--objects DIR] [--sets pybullet,glassware] [--reference 0]

Every photo is made with eight samples and with one, denoised and not, by a Blender of one thread, in turns.
The differences give the price of a sample, of the denoiser, and of all that comes once per photo. Times are
processor time of Blender's process; programs beside it still slow its memory, so the least of `--rounds`
counts. With `--reference N` photos are compared with N samples, not denoised (a minute each at 512).
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from neugrasp.data.world import Cell, Scene
from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.simulation.arrange import arrange
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.materials import sample_materials
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.simulation.renderer import Renderer, RenderSettings

FIRST_SEED = 2000
NUM_INPUTS = 4
PRODUCT = RenderSettings()
VARIANTS = {
    "as photos are made": PRODUCT,
    "twice the samples": replace(PRODUCT, samples=2 * PRODUCT.samples),
    "one sample": replace(PRODUCT, samples=1),
    "not denoised": replace(PRODUCT, denoise="OFF"),
    "one sample, not denoised": replace(PRODUCT, samples=1, denoise="OFF"),
    "denoised at high quality": replace(PRODUCT, denoise="HIGH", prefilter="ACCURATE"),
}


@dataclass(frozen=True)
class Job:
    """A scene in a work cell."""

    cell: Cell
    scene: Scene


def processor_seconds(process_id: int) -> float:
    """User and system time of a process so far (Linux)."""
    fields = Path(f"/proc/{process_id}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def jobs(library: ObjectLibrary, scenes: int) -> list[Job]:
    """Packed scenes and piles of all materials, each in a training cell of its own."""
    workspace = Workspace()
    made = []
    with World(workspace, library, Gripper.load("panda")) as world:
        for seed in range(FIRST_SEED, FIRST_SEED + scenes):
            for kind in ("packed", "pile"):
                scene = arrange(kind, seed, world, library.choices("train", kind))
                scene = sample_materials(scene, "mixed", np.random.default_rng(seed))
                made.append(Job(sample_cell(workspace, "training", seed, "train"), scene))
    return made


def photograph(settings: RenderSettings, job: Job, library: ObjectLibrary) -> tuple[float, Array]:
    """Processor seconds per photo, without the start of Blender, and the photos."""
    with Renderer(1, settings) as renderer:
        renderer.render(job.cell, job.scene, library, [0])
        assert renderer.process_id is not None
        before = processor_seconds(renderer.process_id)
        photos = renderer.render(job.cell, job.scene, library, range(NUM_INPUTS))
        spent = processor_seconds(renderer.process_id) - before
    return spent / NUM_INPUTS, np.stack(photos).astype(float)


def reference(job: Job, library: ObjectLibrary, samples: int) -> Array:
    """Photos with another seed, so that they share no sample with those that are compared."""
    cell = replace(job.cell, seed=job.cell.seed + 7)
    with Renderer(1, RenderSettings(samples=samples, denoise="OFF"), timeout_s=7200) as renderer:
        return np.stack(renderer.render(cell, job.scene, library, range(NUM_INPUTS))).astype(float)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--scenes", type=int, default=2, help="scenes of each kind")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--reference", type=int, default=0, help="samples of the reference; 0: none")
    parser.add_argument("--objects", type=Path, help="a folder of URDF files, as for neugrasp generate")
    parser.add_argument("--sets", default="pybullet,glassware", help="object sets where no folder is given")
    options = parser.parse_args()
    sets = options.sets.split(",") if options.objects is None else ["folder"]
    library = ObjectLibrary.open(sets, options.objects)
    seconds: dict[str, list[float]] = {name: [] for name in VARIANTS}
    errors: dict[str, list[Array]] = {name: [] for name in VARIANTS}
    for job in jobs(library, options.scenes):
        truth = reference(job, library, options.reference) if options.reference else None
        turns = [
            {name: photograph(settings, job, library) for name, settings in VARIANTS.items()}
            for _ in range(options.rounds)
        ]
        for name in VARIANTS:
            seconds[name].append(min(turn[name][0] for turn in turns))
            if truth is not None:
                errors[name].append(np.abs(turns[0][name][1] - truth).mean(axis=-1))
    for name, spent in seconds.items():
        sys.stdout.write(f"{name}: {np.mean(spent):.3f} s a photo")
        if errors[name]:
            off = np.stack(errors[name])
            sys.stdout.write(f", off by {off.mean():.2f} grey levels, 95 % by {np.percentile(off, 95):.1f}")
        sys.stdout.write("\n")


if __name__ == "__main__":
    main()
