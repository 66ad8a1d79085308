"""What there is to show, as plain data. Everything is in the workspace frame: z up, metres."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError
from neugrasp.geometry.surface import Surface
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.observation import Frame, View

Grid = NDArray[np.float32]
Colour = tuple[int, int, int]


@dataclass(frozen=True, eq=False)
class GraspMarker:
    """A grasp to draw, in the workspace frame."""

    grasp: Grasp
    outcome: bool | None = None
    """Whether it held, where it was carried out."""
    note: str = ""
    """What else there is to say of it."""
    number: int | None = None
    """Its place in grasps.json, from 1, where it comes from one."""


@dataclass(frozen=True, eq=False)
class Solid:
    """An object whose shape is known."""

    name: str
    surface: Surface
    colour: Colour


@dataclass(frozen=True, eq=False)
class Truth:
    """What only a simulation knows."""

    tsdf: Grid | None = None
    """The fused grid [x, y, z], free where it was not seen."""
    solids: tuple[Solid, ...] = ()
    grasps: tuple[GraspMarker, ...] = ()
    """Grasps that held in simulation."""

    def __bool__(self) -> bool:
        return self.tsdf is not None or bool(self.solids or self.grasps)


@dataclass(frozen=True, eq=False)
class Snapshot:
    """What was there, or was believed to be there, at one time."""

    caption: str
    tsdf: Grid | None = None
    """The predicted grid [x, y, z] in [-1, 1], positive outside."""
    grasps: tuple[GraspMarker, ...] = ()
    """Best first."""
    solids: tuple[Solid, ...] = ()
    """Objects that are known to lie there."""


@dataclass(frozen=True, eq=False)
class SceneData:
    """Everything that the viewer can show of one path."""

    title: str
    workspace: Workspace
    gripper: Gripper
    views: tuple[Frame, ...] = ()
    """Cameras in the workspace frame, with their photos where there are any."""
    moments: tuple[Snapshot, ...] = (Snapshot("a capture"),)
    truth: Truth = Truth()

    @property
    def photos(self) -> tuple[View, ...]:
        """The cameras that come with photos."""
        return tuple(view for view in self.views if isinstance(view, View))

    def moment(self, index: int) -> Snapshot:
        """Snapshot `index`. Raises `InputError` where there is none."""
        if not 0 <= index < len(self.moments):
            raise InputError(f"moment {index}: {self.title} has moments 0 to {len(self.moments) - 1}")
        return self.moments[index]
