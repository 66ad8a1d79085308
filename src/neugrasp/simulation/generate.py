"""Many records from one seed: in parallel, resumable after a kill at any instant, in any order the same."""

from __future__ import annotations

import hashlib
import json
import logging
import os
import shutil
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from neugrasp.bucket import Bucket, is_url, local_of, url_of
from neugrasp.data.labels import LABELS_FILE
from neugrasp.data.strict_json import parse_json
from neugrasp.errors import InputError
from neugrasp.geometry.view_sets import VIEW_SETS
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper, gripper_hash
from neugrasp.output import write_text
from neugrasp.parallel.choice import crew_for
from neugrasp.parallel.crew import spread
from neugrasp.progress import reached
from neugrasp.run_folder import CONTENTS, check_run_config, check_same, lock, lock_folder, unlock
from neugrasp.simulation.cell_photos import SceneRenderer
from neugrasp.simulation.command import Generate
from neugrasp.simulation.infrared import PhotoAndInfrared
from neugrasp.simulation.objects import KINDS, SPLITS, ObjectLibrary
from neugrasp.simulation.renderer import Renderer, RenderSettings
from neugrasp.simulation.scene_generator import TARGETS_PER_CELL, TARGETS_PER_SCENE, SceneGenerator
from neugrasp.terminal import next_step

DESCRIPTION, TIMING, WHAT = "dataset.json", "timing.json", "data set"
MakeSceneRenderer = Callable[[int], AbstractContextManager[SceneRenderer | None]]
"""Number of threads -> a scene renderer to be used in a with statement."""

logger = logging.getLogger(__name__)


def generate(config: Generate, make_scene_renderer: MakeSceneRenderer | None = None) -> list[Path]:
    """Makes the scenes that `config.out` does not hold yet; the folders of all of them, in order.

    Raises `InputError` where the configuration is not valid or the folder holds another data set, and
    `NeuGraspError` where a scene cannot be made or written.
    """
    config = replace(config, out=local_of(config.out))
    library = _checked(config)
    scene_renderer = (make_scene_renderer or _renderer_of(config)) if config.photos else _nobody
    if is_url(config.out):
        return _generate_into(Bucket.open(config.out), config, library, scene_renderer)
    with _only_one(config.out):
        check_run_config(config.out / DESCRIPTION, _facts(config, library), WHAT, young=CONTENTS)
        for leftover in [*config.out.glob("*/.tmp-*"), *config.out.glob(".tmp-*")]:
            shutil.rmtree(leftover, ignore_errors=True)
        folders = [config.out / "scenes" / config.record_name(index) for index in range(config.num)]
        missing = [index for index, folder in enumerate(folders) if not folder.is_dir()]
        progress = _Progress(total=config.num, done=config.num - len(missing))
        if missing:
            opener = partial(_generator, config, scene_renderer)
            with _at_work(config, missing, opener, progress) as made:
                for seconds in made:
                    progress.add(seconds)
            write_text(config.out / TIMING, progress.text())
    return folders


def _generate_into(
    bucket: Bucket, config: Generate, library: ObjectLibrary, make_scene_renderer: MakeSceneRenderer
) -> list[Path]:
    """As `generate`, into an object store. Workers make scenes in folders of their own; the driver, who alone
    needs to be let in, writes them. Two drivers at once would write the same objects."""
    facts = _facts(config, library)
    found = bucket.read(DESCRIPTION)
    if found is None:
        text = json.dumps(facts, indent=1) + "\n"
        bucket.write({DESCRIPTION: text.encode()}, last=DESCRIPTION)
    else:
        place = f"{bucket.url}/{DESCRIPTION}"
        check_same(parse_json(found, place), place, facts, WHAT, young=CONTENTS)
    there = bucket.folders_with(LABELS_FILE, "scenes")
    names = [config.record_name(index) for index in range(config.num)]
    missing = [index for index, name in enumerate(names) if name not in there]
    progress = _Progress(total=config.num, done=config.num - len(missing))
    if missing:
        opener = partial(_travelling_generator, config, make_scene_renderer)
        with _at_work(config, missing, opener, progress) as made:
            for index, files, seconds in made:
                folder = f"scenes/{names[index]}"
                written = {f"{folder}/{name}": content for name, content in files.items()}
                bucket.write(written, last=f"{folder}/{LABELS_FILE}")
                progress.add(seconds)
        bucket.write({TIMING: progress.text().encode()}, last=TIMING)
    return [config.out / "scenes" / name for name in names]


def run(config: Generate) -> str:
    """`neugrasp generate`: how many scenes there are, and what to do next."""
    folders = generate(config)
    recipe = [] if config.photos else ["--recipe", "head-only"]
    if is_url(config.out):
        return f"{len(folders)} scenes in {url_of(config.out)}; copy it into a folder to learn from it"
    then = next_step("train", *recipe, "--data", config.out, "--out", "runs/mine")
    return f"{len(folders)} scenes in {config.out}\n{then}"


def _renderer_of(config: Generate) -> MakeSceneRenderer:
    settings = RenderSettings(samples=config.samples)
    return partial(PhotoAndInfrared if config.stereo else Renderer, settings=settings)


def _nobody(_threads: int) -> AbstractContextManager[None]:
    """The scene renderer of scenes without photos."""
    return nullcontext()


def _checked(config: Generate) -> ObjectLibrary:
    for value, allowed, what in (
        (config.scene, KINDS, "--scene"),
        (config.split, SPLITS, "--split"),
        (config.views, tuple(VIEW_SETS), "--views"),
    ):
        if value not in allowed:
            raise InputError(f"{what} {value!r}; choose one of {', '.join(allowed)}")
    for number, what in (
        (config.num, "--num"),
        (config.scenes_per_cell, "--scenes-per-cell"),
        (config.grasp_points, "--grasp-points"),
        (config.workers if config.workers is not None else 1, "--workers"),
    ):
        if number < 1:
            raise InputError(f"{what} {number}; it must be at least 1")
    if not 1 <= config.targets <= TARGETS_PER_CELL:
        raise InputError(f"--targets {config.targets}; a work cell has 1 to {TARGETS_PER_CELL}")
    RenderSettings(samples=config.samples)  # refuses what is no power of two
    if config.stereo and not config.photos:
        raise InputError("--stereo: depth is measured beside photos; leave --no-photos out")
    if config.seed < 0:
        raise InputError(f"--seed {config.seed}; it must be at least 0")
    Gripper.load(config.gripper)
    Workspace.with_edge(config.cube, config.resolution)
    library = ObjectLibrary.open(config.sets, config.objects)
    library.choices(config.split, config.scene)
    return library


def _facts(config: Generate, library: ObjectLibrary) -> dict[str, Any]:
    """What the scenes depend on."""
    choices = library.choices(config.split, config.scene)
    return {
        "format": "neugrasp-dataset",
        "version": 1,
        "scene": config.scene,
        "object_sets": list(config.sets),
        "objects_sha256": hashlib.sha256(json.dumps(choices).encode()).hexdigest(),
        "objects_content_sha256": library.content_hash(choices),
        "materials": config.materials,
        "views": config.views,
        "split": config.split,
        "gripper": config.gripper,
        "gripper_sha256": gripper_hash(config.gripper),
        "grasp_points": config.grasp_points,
        "scenes_per_cell": config.scenes_per_cell,
        "image_size": config.image_size,
        "samples": config.samples,
        "seed": config.seed,
        **({} if config.photos else {"photos": False}),
        **Workspace.with_edge(config.cube, config.resolution).unusual(),
        **({"stereo": True} if config.stereo else {}),
        **({} if config.targets == TARGETS_PER_SCENE else {"targets": config.targets}),
    }


@contextmanager
def _only_one(out: Path) -> Iterator[None]:
    """Holds `out` for this process. Waits for workers that outlive a killed run by a moment."""
    with lock_folder(out, "generate"), (out / ".lock-workers").open("w", encoding="utf-8") as workers:
        lock(workers, waits=True)
        unlock(workers)
        yield


@dataclass
class _Progress:
    """What is done and how fast."""

    total: int
    done: int
    made: int = 0
    start: float = field(default_factory=time.monotonic)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))

    def add(self, seconds: dict[str, float]) -> None:
        """Counts a scene that took `seconds` by stage."""
        self.done, self.made = self.done + 1, self.made + 1
        for stage, spent in seconds.items():
            self.seconds[stage] += spent
        rate = self.made / (time.monotonic() - self.start)
        left = (self.total - self.done) / rate / 60
        reached("scenes", self.done, self.total)
        logger.info("%d of %d scenes, %.0f an hour, %.0f min left", self.done, self.total, rate * 3600, left)

    def text(self) -> str:
        """The time by stage, summed over workers, of the scenes made in this run, as JSON."""
        wall = time.monotonic() - self.start
        per_scene = {stage: round(spent / self.made, 3) for stage, spent in self.seconds.items()}
        rate = round(3600 * self.made / wall, 1)
        data = {"scenes": self.made, "wall_s": round(wall, 1), "scenes_per_hour": rate}
        return json.dumps({**data, "seconds_per_scene": per_scene}, indent=1) + "\n"


@contextmanager
def _at_work(
    config: Generate, missing: list[int], opener: Callable[[int], Any], progress: _Progress
) -> Iterator[Iterator[Any]]:
    """What workers tell of the scenes that are missing, as they are made; `opener` takes a worker's number of
    threads."""
    reached("scenes", progress.done, progress.total)
    crew, threads = crew_for(config.workers, len(missing), config.cluster)
    workers = config.workers or len(os.sched_getaffinity(0))
    with closing(spread(crew, partial(opener, threads), _groups(config, missing, workers))) as made:
        yield made


@contextmanager
def _generator(
    config: Generate, make_scene_renderer: MakeSceneRenderer, threads: int
) -> Iterator[Callable[[int], dict[str, float]]]:
    """What makes the scene of a number; the seconds it took by stage."""
    with (config.out / ".lock-workers").open("w", encoding="utf-8") as file:
        lock(file, shared=True, waits=True)
        with _opened_generator(config, make_scene_renderer, threads) as generator:
            yield partial(_make, generator)


@contextmanager
def _travelling_generator(
    config: Generate, make_scene_renderer: MakeSceneRenderer, threads: int
) -> Iterator[Callable[[int], tuple[int, dict[str, bytes], dict[str, float]]]]:
    """What makes the scene of a number: the number, the files, and the seconds by stage."""
    with tempfile.TemporaryDirectory(prefix="neugrasp-") as folder:
        own = replace(config, out=Path(folder))
        with _opened_generator(own, make_scene_renderer, threads) as generator:
            yield partial(_packed, generator)


@contextmanager
def _opened_generator(
    config: Generate, make_scene_renderer: MakeSceneRenderer, threads: int
) -> Iterator[SceneGenerator]:
    with make_scene_renderer(threads) as scene_renderer:
        generator = SceneGenerator(config, scene_renderer)
        with generator.world:
            yield generator


def _packed(generator: SceneGenerator, index: int) -> tuple[int, dict[str, bytes], dict[str, float]]:
    """Makes a scene and takes it along."""
    seconds = _make(generator, index)
    folder = generator.config.out / "scenes" / generator.config.record_name(index)
    files = {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}
    shutil.rmtree(folder)
    return index, files, seconds


def _make(generator: SceneGenerator, index: int) -> dict[str, float]:
    """Makes a scene; the seconds it took by stage."""
    before = dict(generator.seconds)
    generator.make(index)
    return {stage: spent - before.get(stage, 0.0) for stage, spent in generator.seconds.items()}


def _groups(config: Generate, missing: list[int], workers: int) -> list[list[int]]:
    """Scenes of one cell go to one worker, so that its backgrounds are rendered once, if enough are left."""
    cells: dict[int, list[int]] = defaultdict(list)
    for index in missing:
        cells[index // config.scenes_per_cell].append(index)
    size = max(1, min(config.scenes_per_cell, -(-len(missing) // workers)))
    return [indices[i : i + size] for indices in cells.values() for i in range(0, len(indices), size)]
