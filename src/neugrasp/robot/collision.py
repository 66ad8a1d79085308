"""What arm, hand and camera would touch: the only file that imports FCL, a library of collision checks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from neugrasp.errors import require
from neugrasp.geometry.pose import Array, inverse, rigid
from neugrasp.geometry.surface import Surface
from neugrasp.robot.arm_model import ArmModel
from neugrasp.robot.limits import Box
from neugrasp.robot.tool import Tool

TABLE_EDGE, TABLE_DEPTH = 3.0, 0.2
"""Metres of the box that stands for the table."""
TABLE_SLACK = 0.001
"""Metres by which fingers may enter the table on their way to a grasp: hulls and planes are no finer."""
LOWEST_LINK = 2
"""The first moving link that could touch the table on which the arm stands."""
APART = 2
"""Links so many joints apart can touch; nearer ones are joined by design."""
GROWN_TOGETHER = 0.012
"""Metres around what is held in which the surface is taken to be its own: with neighbours it is one."""
MOUNTED_BESIDE = 3
"""The camera is held against links up to this one; it is mounted around the later ones."""


@dataclass(frozen=True)
class Surroundings:
    """What stands around an arm, world frame."""

    world_from_table: Array
    """z points away from its surface."""
    keep_out: tuple[Box, ...] = ()
    surface: Surface | None = None
    """What was seen on the table."""
    clearance: float = 0.0
    """Metres that everything keeps from the surface on ways in the open."""


@dataclass(frozen=True)
class Carried:
    """A hand that holds something, as the library has it; made by `CollisionChecker.carrying`."""

    fingers: tuple[Any, ...]
    held: tuple[Any, ...]
    """One convex part, or none."""
    others: tuple[Any, ...] = ()
    """One mesh of what was seen but for what is held, once this is lifted out of it, or none."""


class CollisionChecker:
    """One arm with its tool in its surroundings."""

    def __init__(self, model: ArmModel, tool: Tool, world_from_base: Array, around: Surroundings):
        """Raises `MissingExtra` without FCL."""
        self._fcl: Any = require("fcl", extra="robot")
        self._model = model
        self._request = self._fcl.CollisionRequest()
        self._links = [(c.frame, *self._capsule(c.start, c.end, c.radius)) for c in model.capsules]
        self._hand = self._convex(np.concatenate([*tool.palm, *tool.fingers]))
        self._palm = [self._convex(hull) for hull in tool.palm]
        self._fingers = [self._convex(hull) for hull in tool.fingers]
        self._camera = [self._convex(hull) for hull in tool.camera]
        base_from_world = inverse(world_from_base)
        base_from_table = base_from_world @ around.world_from_table
        self._table = self._box(base_from_table, 0.0)
        self._lowered_table = self._box(base_from_table, TABLE_SLACK)
        self._keep_out = [self._kept_out(base_from_world, box) for box in around.keep_out]
        self._base_from_world, self._surface_seen = base_from_world, around.surface
        self._surface = self._mesh(around.surface)
        self._wide = self._widened(tool, around.clearance) if self._surface else []
        self._self_pairs = self._pairs()

    def carrying(self, fingers: Sequence[Array], held: Array | None) -> Carried:
        """The hand after a grasp: its fingers where they closed, as corners of convex parts, and corners
        (n, 3) around what they hold; all in the flange's frame."""
        return Carried(
            tuple(self._convex(hull) for hull in fingers), () if held is None else (self._convex(held),)
        )

    def lifted(self, carried: Carried, held: Array | None) -> Carried:
        """The same when what is held, around which the corners `held` (8, 3) stood in the world, is above
        where it stood: from then on it is kept out of all else that was seen, too."""
        if held is None or self._surface_seen is None:
            return carried
        return replace(carried, others=self._mesh(_without(self._surface_seen, held)))

    def is_free(self, joints: Array, grasping: bool = False, carried: Carried | None = None) -> bool:
        """Whether nothing touches anything with the joints at (6,). On the straight way to a grasp,
        `grasping`, no distance is kept, and the fingers may enter the surface: they are about to close on
        it. What is `carried` is held against table, keep-out boxes and arm: the surface shows itself, too;
        once `lifted`, against the rest of the surface."""
        frames = self._model.frames(joints)
        wide = [] if grasping else self._wide
        self._place(frames, wide)
        fingers = self._fingers if carried is None else carried.fingers
        held = () if carried is None else carried.held
        others = () if carried is None else carried.others
        for body in (*held, *(() if carried is None else fingers)):
            self._put(body, frames[-1])
        links = [body for frame, body, _ in self._links if frame >= LOWEST_LINK]
        apart = (*self._camera, *self._palm, *reversed(links))
        lowered = (self._lowered_table, *self._keep_out)
        solid = (self._table, *self._keep_out)
        near = self._surface if grasping else ()
        return not (
            self._any((body, other) for body in fingers for other in (lowered if grasping else solid))
            or self._any((body, other) for body in held for other in (*lowered, *others))
            or self._any((body, link) for body in held for link in links if link is not self._links[-1][1])
            or self._any((body, mesh) for _, body, _ in wide for mesh in self._surface)
            or self._any((body, other) for body in apart for other in (*solid, *near))
            or self._any(self._self_pairs)
        )

    def _any(self, pairs: Iterable[tuple[Any, Any]]) -> bool:
        result = self._fcl.CollisionResult
        return any(self._fcl.collide(a, b, self._request, result()) for a, b in pairs)

    def _place(self, frames: Array, wide: Sequence[tuple[int, Any, Array]]) -> None:
        for frame, body, in_frame in (*self._links, *wide):
            self._put(body, frames[frame] @ in_frame)
        for body in (self._hand, *self._palm, *self._fingers, *self._camera):
            self._put(body, frames[-1])

    def _put(self, body: Any, base_from_body: Array) -> None:
        body.setTransform(self._fcl.Transform(base_from_body[:3, :3], base_from_body[:3, 3]))

    def _widened(self, tool: Tool, by: float) -> list[tuple[int, Any, Array]]:
        """All that moves, thicker by a distance, with its frame and its pose there: what was seen is no solid
        whose distance to others could be asked."""
        corners = by * (np.indices((2, 2, 2)).reshape(3, -1).T * 2.0 - 1)
        hulls = (*tool.fingers, *tool.camera, *tool.palm)
        parts = [self._convex((hull[:, None] + corners).reshape(-1, 3)) for hull in hulls]
        links = [
            (c.frame, *self._capsule(c.start, c.end, c.radius + by))
            for c in reversed(self._model.capsules)
            if c.frame >= LOWEST_LINK
        ]
        return [*((-1, part, np.eye(4)) for part in parts), *links]

    def _pairs(self) -> list[tuple[Any, Any]]:
        links = [(frame, body) for frame, body, _ in self._links]
        pairs = [(a, b) for i, a in links for j, b in links if j - i >= APART]
        pairs += [(self._hand, body) for frame, body in links if frame <= self._hand_reaches()]
        return pairs + [(c, body) for c in self._camera for frame, body in links if frame <= MOUNTED_BESIDE]

    def _hand_reaches(self) -> int:
        """The last link that the hand, which the last one carries, can touch."""
        return len(self._model.d) - APART

    def _object(self, geometry: Any, pose: Array) -> Any:
        return self._fcl.CollisionObject(geometry, self._fcl.Transform(pose[:3, :3], pose[:3, 3]))

    def _capsule(self, start: Sequence[float], end: Sequence[float], radius: float) -> tuple[Any, Array]:
        """A capsule, and its pose in its frame; the library's lies along z."""
        along = np.subtract(end, start)
        length = float(np.linalg.norm(along))
        z = along / length if length > 0 else np.array([0.0, 0.0, 1.0])
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        x /= np.linalg.norm(x)
        pose = rigid(np.stack([x, np.cross(z, x), z], axis=1), np.add(start, end) / 2)
        return self._object(self._fcl.Capsule(radius, length), pose), pose

    def _convex(self, points: Array) -> Any:
        hull = ConvexHull(points)
        corners = np.ascontiguousarray(points[hull.vertices])
        number = {old: new for new, old in enumerate(hull.vertices)}
        middle = corners.mean(axis=0)
        faces = []
        for face in hull.simplices:
            a, b, c = points[face]
            outwards = float(np.cross(b - a, c - a) @ (a - middle)) > 0
            faces.append([3, *(number[i] for i in (face if outwards else face[::-1]))])
        shape = self._fcl.Convex(corners, len(faces), np.array(faces, dtype=np.int32).ravel())
        return self._object(shape, np.eye(4))

    def _box(self, base_from_table: Array, lowered: float) -> Any:
        pose = base_from_table @ rigid(translation=(0, 0, -TABLE_DEPTH / 2 - lowered))
        return self._object(self._fcl.Box(TABLE_EDGE, TABLE_EDGE, TABLE_DEPTH), pose)

    def _kept_out(self, base_from_world: Array, box: Box) -> Any:
        pose = base_from_world @ rigid(translation=(box.low + box.high) / 2)
        return self._object(self._fcl.Box(*(box.high - box.low).tolist()), pose)

    def _mesh(self, surface: Surface | None) -> tuple[Any, ...]:
        """One mesh, or none."""
        if surface is None or not len(surface.faces):
            return ()
        mesh = self._fcl.BVHModel()
        mesh.beginModel(len(surface.vertices), len(surface.faces))
        mesh.addSubModel(np.asarray(surface.vertices, dtype=np.float64), np.asarray(surface.faces))
        mesh.endModel()
        return (self._object(mesh, self._base_from_world),)


def _without(surface: Surface, held: Array) -> Surface:
    """A surface but for what is in a box, or at its faces: corners (8, 3) in the order of `held_box`."""
    middle = held.mean(axis=0)
    edges = held[[4, 2, 1]] - held[0]
    lengths = np.linalg.norm(edges, axis=1)
    places = (np.asarray(surface.vertices) - middle) @ (edges / lengths[:, None]).T
    inside = np.all(np.abs(places) <= lengths / 2 + GROWN_TOGETHER, axis=1)
    return Surface(surface.vertices, surface.faces[~np.any(inside[surface.faces], axis=1)])
