"""The fixed rounds: what lies where, what it is made of, and the work cell around it, from a seed.

Round i of a kind, a seed and an object set is the same for every detector. Where its objects lie and how its
cell looks do not depend on the materials or on the views either.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from neugrasp.data.world import Cell, Scene
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.arrange import Choices, arrange
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.domain import Domain
from neugrasp.simulation.lab import DOMAINS, domain_of
from neugrasp.simulation.materials import sample_materials
from neugrasp.simulation.objects import KINDS, ObjectLibrary
from neugrasp.simulation.physics import World

MAX_ATTEMPTS = 20
"""Arrangements tried before a round is given up; each has its own seed."""
DEFAULT_ROUNDS = 200
STAGES = ("scene", "materials", "cell", "views", "choice")


@dataclass(frozen=True)
class Round:
    """Everything that is fixed about a round, as plain data."""

    index: int
    scene: Scene
    """At rest, with materials."""
    cell: Cell
    """Its cameras are cropped to the workspace, for photos."""
    sensors: tuple[Camera, ...]
    """The same cameras, whole, for depth."""

    @property
    def scene_sha256(self) -> str:
        """Hash of what lies where; materials do not count."""
        bodies = json.dumps([asdict(body) for body in self.scene.bodies])
        return hashlib.sha256(bodies.encode()).hexdigest()


def num_rounds(kind: str, choices: Choices, wanted: int | None) -> int:
    """How many rounds are played: by default 200, or one per object where each stands alone.

    Raises `InputError` where there cannot be that many.
    """
    if wanted is not None and wanted < 1:
        raise InputError(f"--rounds {wanted}; it must be at least 1")
    if kind != "single":
        return wanted or DEFAULT_ROUNDS
    if wanted is not None and wanted > len(choices):
        raise InputError(f"--rounds {wanted}; there are {len(choices)} objects, each of which has one round")
    return wanted or len(choices)


@dataclass(frozen=True)
class Rounds:
    """The rounds of one kind of scene, one seed and one object set."""

    kind: str
    """ "pile", "packed" or "single"."""
    seed: int
    library: ObjectLibrary
    materials: str
    views: str
    num_objects: int = 5
    image_size: int = 256
    split: str = "test"
    domain: Domain = DOMAINS["training"]

    @classmethod
    def of_facts(cls, facts: Mapping[str, Any], library: ObjectLibrary) -> Rounds:
        """Those of an evaluation whose run.json says `facts`."""
        more = {"split": facts.get("split", "test"), "domain": domain_of(facts.get("domain", "training"))}
        return cls(facts["scene"], facts["seed"], library, facts["materials"], facts["views"], **more)

    def make(self, index: int, world: World) -> Round:
        """Round `index`; `world` is used to lay it and holds something else afterwards."""
        scene = self._arranged(index, world)
        scene = sample_materials(scene, self.materials, self._rng("materials", index))
        workspace = world.workspace
        sensors = self.sensors(index, workspace)
        size = self.image_size
        cropped = tuple(c.cropped_and_resized(workspace.photo_box(c), size, size) for c in sensors)
        seed = int(self._sequence("cell", index).generate_state(1)[0])
        cell = sample_cell(workspace, "released", seed, self.split, size=size, num_targets=0)
        cell = replace(cell, cameras=cropped, num_inputs=len(cropped))
        return Round(index, scene, self.domain.cell(cell, sensors, workspace), sensors)

    def sensors(self, index: int, workspace: Workspace) -> tuple[Camera, ...]:
        """Where the cameras of round `index` stand, workspace frame."""
        return tuple(view_set(self.views, workspace, self._rng("views", index)))

    def choice_rng(self, index: int, attempt: int) -> np.random.Generator:
        """The random numbers with which a grasp is chosen."""
        return self._rng("choice", index, attempt)

    def _arranged(self, index: int, world: World) -> Scene:
        choices = self.library.choices(self.split, self.kind)
        if self.kind == "single":
            choices = (choices[index],)
        for attempt in range(MAX_ATTEMPTS):
            seed = int(self._sequence("scene", index, attempt).generate_state(1)[0])
            scene = arrange(self.kind, seed, world, choices, self.num_objects)
            if scene.bodies:
                return scene
        raise NeuGraspError(f"round {index}: nothing stayed on the table in {MAX_ATTEMPTS} attempts")

    def _rng(self, stage: str, *numbers: int) -> np.random.Generator:
        return np.random.default_rng(self._sequence(stage, *numbers))

    def _sequence(self, stage: str, *numbers: int) -> np.random.SeedSequence:
        """Independent streams by kind of scene, stage and round, apart from those of `generate`."""
        key = (KINDS.index(self.kind), STAGES.index(stage), *numbers)
        return np.random.SeedSequence([self.seed, 77, *key])
