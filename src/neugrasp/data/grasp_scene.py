"""A scene to learn from, whoever made it: photos, grasps that were tried, and the truth where there is one.

The simulator keeps more of its scenes (`data/records.py`), a real cell knows less (`data/captures.py`);
training reads either as this.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.labels import GraspLabels
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Views


@dataclass(frozen=True)
class SceneTruth:
    """What only a simulator knows: the surface, and the depth of the photos.

    Grids (r, r, r) are indexed [x, y, z].
    """

    tsdf: NDArray[np.float32]
    """Fused from depth images of many views, in [-1, 1]; -1 where not observed."""
    observed: NDArray[np.bool_]
    distance: NDArray[np.float32] | None = None
    """Signed distance of the meshes, in units of the truncation, in [-1, 1]; None where it was not stored."""
    fused: NDArray[np.float32] | None = None
    """(g, r, r, r) grids as VGN reads them (`geometry.fusion.vgn_grid`), each of a few views of its own; None
    where nobody asked for them."""
    depths: NDArray[np.float32] | None = None
    """(n, s, s) z-depth of the input views, metres; 0 where there is no surface."""
    masks: NDArray[np.int8] | None = None
    """(n, s, s) of the input views: -1 nothing, 0 table, i + 1 body i."""


@dataclass(frozen=True)
class GraspScene:
    """What training may know of one scene. All poses are in the workspace frame."""

    name: str
    workspace: Workspace
    """The cube, at the origin."""
    labels: GraspLabels
    views: Views | None = None
    """Photos for the input; None where there are none, or none were read."""
    targets: Views | None = None
    """Photos that are never an input, for losses to compare with. A scene with `views` alone lends some of
    them (`training/samples.py`)."""
    truth: SceneTruth | None = None
    stereo: NDArray[np.float32] | None = None
    """(n, s, s) z-depth of the input views as a stereo sensor measured it, metres; 0 where it measured
    nothing. None where there was no such sensor."""
