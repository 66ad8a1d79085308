"""Where a record is made: a physics world, a scene renderer and a gripper, kept from scene to scene."""

from __future__ import annotations

import logging
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.records import Record, without_photos, write_record
from neugrasp.data.trials import State
from neugrasp.data.world import Cell, Scene
from neugrasp.errors import InputError, NeuGraspError, WriteError
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.simulation.arrange import arrange
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.cell_photos import SceneRenderer, backgrounds
from neugrasp.simulation.command import Generate
from neugrasp.simulation.grasp_sampling import label
from neugrasp.simulation.grasp_trials import label_trials
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.materials import sample_materials
from neugrasp.simulation.mesh_distance import mesh_distance
from neugrasp.simulation.objects import KINDS, ObjectLibrary
from neugrasp.simulation.physics import World
from neugrasp.simulation.stereo_sensor import stereo_on_photo

TARGETS_PER_CELL = 4
TARGETS_PER_SCENE = 2
MAX_ATTEMPTS = 20
"""Arrangements tried before a scene is given up; each has its own seed."""

logger = logging.getLogger(__name__)


@dataclass
class SceneGenerator:
    """Makes one scene after another; which came before makes no difference."""

    config: Generate
    scene_renderer: SceneRenderer | None
    """None where the scenes get no photos."""
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Wall time spent so far, by stage."""

    def __post_init__(self) -> None:
        config = self.config
        self.workspace = Workspace.with_edge(config.cube, config.resolution)
        self.library = ObjectLibrary.open(config.sets, config.objects)
        self.choices = self.library.choices(config.split, config.scene)
        self.world = World(self.workspace, self.library, Gripper.load(config.gripper))

    def make(self, index: int) -> Path:
        """Makes and writes scene `index`; the folder of its record."""
        with self._timed("arrange"):
            scene = self._arranged(index)
            # From the stored poses, so that whoever rebuilds the scene finds the world that was labelled.
            self.world.reset(scene)
        with self._timed("tsdf"):
            tsdf = scan(self.world, self.workspace)
        with self._timed("distance"):
            distance = mesh_distance(scene.bodies, self.library, self.workspace)
        with self._timed("grasps"):
            grasps = label(self.world, self._rng("grasps", index), num_points=self.config.grasp_points)
        record = Record(
            name=self.config.record_name(index),
            scene=scene,
            **self._seen(index, scene),
            tsdf=tsdf.values,
            observed=tsdf.observed,
            labels=grasps.labels,
            distance=distance,
            trials=label_trials(
                grasps.poses,
                grasps.trials,
                State(replace(scene, materials=()), distance),
                self.config.gripper,
            ),
        )
        with self._timed("write"):
            folder = self.config.out / "scenes" / record.name
            write_record(folder, record)
        return folder

    def _seen(self, index: int, scene: Scene) -> dict[str, Any]:
        """The fields of a `Record` that depend on a work cell: photos, depth, and the cell itself."""
        config, cell_index = self.config, index // self.config.scenes_per_cell
        if self.scene_renderer is None:
            return {"cell": {"photos": False, "split": config.split, **self._cube()}, **without_photos()}
        cell = self._cell(cell_index)
        with self._timed("backgrounds"):
            folder = config.out / "cells" / f"{cell_index:06d}"
            empty = backgrounds(cell, folder, self.scene_renderer, self.library)
        inputs, others = list(range(cell.num_inputs)), range(cell.num_inputs, len(cell.cameras))
        rng = self._rng("targets", index)
        targets = sorted(rng.choice(others, config.targets, replace=False).tolist())
        cameras = tuple(cell.cameras[i] for i in inputs)
        with self._timed("depth"):
            looks = [self.world.depth_and_mask(camera) for camera in cameras]
        with self._timed("render"):
            photos = np.stack(self.scene_renderer.render(cell, scene, self.library, inputs + targets))
        with self._timed("stereo"):
            measured = [
                stereo_on_photo(camera, cell, scene, self.scene_renderer, self.library, self.workspace)
                for camera in (cameras if config.stereo else ())
            ]
        drawn = {"light": cell.light, "table": cell.table, "views": config.views, "split": config.split}
        return {
            "cell": {"index": cell_index, "seed": cell.seed, **drawn, "targets": targets, **self._cube()},
            "images": photos[: len(inputs)],
            "backgrounds": empty[inputs],
            "cameras": cameras,
            "targets": photos[len(inputs) :],
            "target_backgrounds": empty[targets],
            "target_cameras": tuple(cell.cameras[i] for i in targets),
            "depths": np.stack([depth for depth, _ in looks]).astype(np.float32),
            "masks": np.stack([mask for _, mask in looks]).astype(np.int8),
            "stereo": np.stack(measured) if measured else None,
        }

    def _cube(self) -> dict[str, Any]:
        """What a record says of a cube that is not the usual one."""
        unusual = self.workspace.unusual()
        return {"workspace": unusual} if unusual else {}

    def _cell(self, cell_index: int) -> Cell:
        config = self.config
        return sample_cell(
            self.workspace,
            config.views,
            self._seed("cell", cell_index),
            config.split,
            size=config.image_size,
            num_targets=TARGETS_PER_CELL,
        )

    def _arranged(self, index: int) -> Scene:
        """The settled scene, which also stands in `world`. An arrangement that fails is drawn anew."""
        reason = "nothing stayed on the table"
        for attempt in range(MAX_ATTEMPTS):
            seed = self._seed("scene", index, attempt)
            try:
                scene = arrange(self.config.scene, seed, self.world, self.choices)
            except (InputError, WriteError):
                raise
            except NeuGraspError as error:
                reason, scene = str(error), None
            if scene is not None and scene.bodies:
                return sample_materials(scene, self.config.materials, self._rng("materials", index))
            logger.warning("scene %d, attempt %d: %s; drawn anew", index, attempt, reason)
        raise NeuGraspError(f"scene {index}: no arrangement in {MAX_ATTEMPTS} attempts ({reason})")

    def _seed(self, stage: str, *numbers: int) -> int:
        return int(self._sequence(stage, *numbers).generate_state(1)[0])

    def _rng(self, stage: str, *numbers: int) -> np.random.Generator:
        return np.random.default_rng(self._sequence(stage, *numbers))

    def _sequence(self, stage: str, *numbers: int) -> np.random.SeedSequence:
        """Independent streams by kind of scene, stage and index."""
        stages = ("cell", "scene", "materials", "targets", "grasps")
        key = (KINDS.index(self.config.scene), stages.index(stage), *numbers)
        return np.random.SeedSequence([self.config.seed, *key])

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[stage] += time.perf_counter() - start
