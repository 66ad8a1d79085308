"""Simulated bodies as solids: their own meshes where they lie."""

from __future__ import annotations

import logging
from pathlib import Path

from neugrasp.data.world import Body, Scene
from neugrasp.errors import NeuGraspError
from neugrasp.geometry.pose import from_quaternion
from neugrasp.geometry.surface import Surface
from neugrasp.simulation.meshes import merged, read_obj
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.viewer.scene_data import Colour, Solid

log = logging.getLogger(__name__)
COLOURS: tuple[Colour, ...] = (
    (90, 140, 200),
    (230, 160, 70),
    (120, 180, 120),
    (165, 120, 190),
    (214, 110, 80),
    (110, 190, 200),
    (210, 140, 170),
    (150, 150, 90),
)


def solids_of(
    scene: Scene, objects: Path | None, colours: dict[Identity, Colour] | None = None
) -> tuple[Solid, ...]:
    """The bodies of a scene; those whose model cannot be found are left out with a warning."""
    names = sorted({body.object_set for body in scene.bodies})
    if not names:
        return ()
    try:
        library = ObjectLibrary.open(names, objects)
        return tuple(
            _solid(library, body, (colours or {}).get(identity(body), COLOURS[i % len(COLOURS)]))
            for i, body in enumerate(scene.bodies)
        )
    except NeuGraspError as error:
        log.warning("bodies cannot be drawn: %s", error)
        return ()


Identity = tuple[str, str, float]
"""What stays the same of a body that moves: set, name and scale."""


def identity(body: Body) -> Identity:
    """What tells a body from others wherever it lies."""
    return body.object_set, body.name, body.scale


def _solid(library: ObjectLibrary, body: Body, colour: Colour) -> Solid:
    mesh = merged(read_obj(library.model(body.object_set, body.name).visual_mesh))
    surface = Surface(mesh.vertices * body.scale, mesh.faces.astype("int32"))
    return Solid(body.name, surface.moved(from_quaternion(body.quaternion_xyzw, body.position)), colour)
