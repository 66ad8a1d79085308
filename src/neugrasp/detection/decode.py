"""Grasp volume -> grasps: smoothing, masks, non-maximum suppression, and a count of what fell out and why.

The voxel of a grasp holds its *grasp point*, at the roots of the fingers; the TCP lies `tcp_depth` further
along the approach (docs/conventions.md).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float32, Float64, Int64
from numpy.typing import NDArray
from scipy import ndimage

from neugrasp.detection.collision_filter import CollisionFilter
from neugrasp.detection.contract import Detection
from neugrasp.geometry.fusion import Grid
from neugrasp.geometry.pose import from_quaternion, to_quaternion
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper


@dataclass(frozen=True)
class SelectionConfig:
    """VGN's released constants, as all systems of the paper use them, and a check that they lack."""

    threshold: float = 0.9
    """Smoothed quality below which a voxel is no grasp."""
    smoothing: float = 1.0
    """Standard deviation of the Gaussian over the quality, voxels."""
    inside: tuple[float, float] = (-0.85, 0.0)
    """Signed distances that count as just inside an object; grasp points lie elsewhere."""
    reach: int = 2
    """Voxels by which the outside is grown into what is neither outside nor inside."""
    suppression: int = 4
    """Edge of the cube, in voxels, in which only the best grasp survives."""
    min_width: float = 0.01
    """Narrowest opening, metres; the widest is `max_opening` less this."""
    hand: CollisionFilter | None = None
    """Moves grasps as deep as the surface lets the hand, and drops what it speaks against; None: neither."""


@dataclass(frozen=True)
class Prediction:
    """What the network says of every voxel, as arrays [x, y, z] in the workspace frame."""

    tsdf: Float32[np.ndarray, "r r r"]
    """In [-1, 1]."""
    quality: Float32[np.ndarray, "r r r"]
    """In [0, 1]."""
    width: Float32[np.ndarray, "r r r"]
    """Voxels."""
    rotations: Callable[[Int64[np.ndarray, "n 3"]], Float32[np.ndarray, "n 4"]]
    """Quaternions xyzw at the voxels of these indices: few are ever asked for."""


def stored(rotation: Float32[np.ndarray, "4 r r r"]) -> Callable[[NDArray[np.int64]], NDArray[np.float32]]:
    """The `rotations` of a `Prediction` that has the quaternions of all voxels."""
    return lambda voxels: np.ascontiguousarray(rotation[(slice(None), *voxels.T)].T)


@dataclass(frozen=True)
class Selection:
    """Grasps in the workspace frame, best first, and how many voxels each rule rejected."""

    grasps: tuple[Grasp, ...]
    rejected: dict[str, int]
    best_rejected: float
    """The best smoothed quality of a voxel on a surface; says how far the threshold was."""
    margin: float | None = None
    """As in `Detection`."""

    def detection(
        self,
        workspace: Workspace,
        gripper: Gripper,
        tsdf: Grid,
        threshold: float,
        timing_s: Mapping[str, float] | None = None,
        source: str = "",
    ) -> Detection:
        """What a detector with this surface returns: the grasps in the user's world."""
        placed = workspace.world_from_workspace
        return Detection(
            Grasps.of(grasp.moved(placed) for grasp in self.grasps),
            workspace,
            gripper,
            tsdf,
            self.rejected,
            self.best_rejected,
            threshold,
            timing_s or {},
            source,
            self.margin,
        )


def near_surface(tsdf: Grid, config: SelectionConfig) -> Bool[np.ndarray, "r r r"]:
    """Voxels where a grasp point may lie: outside, or just under what is outside, but not inside."""
    outside = tsdf > 0
    inside = (tsdf > config.inside[0]) & (tsdf < config.inside[1])
    grown = ndimage.binary_dilation(outside, iterations=config.reach, mask=~inside)
    return np.asarray(grown, dtype=np.bool_)


def select_grasps(
    prediction: Prediction,
    workspace: Workspace,
    gripper: Gripper,
    config: SelectionConfig | None = None,
) -> Selection:
    """Ranked grasps; every voxel ends as a grasp or in one of the rejection counts."""
    config = config or SelectionConfig()
    quality = ndimage.gaussian_filter(prediction.quality, config.smoothing, mode="nearest")
    width = prediction.width * workspace.voxel_size
    rejected: dict[str, int] = {}
    alive = np.ones(quality.shape, dtype=bool)

    def reject(reason: str, good: NDArray[np.bool_]) -> None:
        nonlocal alive
        rejected[reason] = int(np.count_nonzero(alive & ~good))
        alive = alive & good

    reject("off_the_surface", near_surface(prediction.tsdf, config))
    best = float(quality[alive].max(initial=0.0))
    reject("quality_below_threshold", quality >= config.threshold)
    reject("too_narrow", width >= config.min_width)
    reject("too_wide_for_the_gripper", width <= gripper.max_opening - config.min_width)
    candidates = np.where(alive, quality, 0.0)
    reject("not_the_best_nearby", candidates == ndimage.maximum_filter(candidates, config.suppression))
    peaks = np.argwhere(alive)[np.argsort(-quality[alive], kind="stable")]
    grasps = tuple(
        decode_grasp(workspace, gripper, index, quaternion, float(width[index]), float(quality[index]))
        for index, quaternion in zip(map(tuple, peaks.tolist()), prediction.rotations(peaks), strict=True)
    )
    # Last, not before the suppression: the neighbours that would take the place of a peak that fails pass
    # only just, and hold less often.
    if config.hand is not None:
        placed = Grasps.of(grasps)
        margin = config.hand.depth_margin(prediction.tsdf, workspace, placed.poses, placed.widths)
        grasps = tuple(grasp.advanced(further) for grasp, further in zip(grasps, margin, strict=True))
        placed = Grasps.of(grasps)
        holds, is_free = config.hand.passes(prediction.tsdf, workspace, placed.poses, placed.widths)
        rejected["nothing_between_the_fingers"] = int(np.count_nonzero(~holds))
        rejected["hand_would_collide"] = int(np.count_nonzero(holds & ~is_free))
        passes = holds & is_free
        deep = passes & (margin > config.hand.least_depth_margin)
        # Half of the others slip: worth a try only where nothing is held better.
        kept = deep if deep.any() else passes
        rejected["held_by_the_rim"] = int(np.count_nonzero(passes & ~kept))
        grasps = tuple(grasp for grasp, is_kept in zip(grasps, kept, strict=True) if is_kept)
    return Selection(grasps, rejected, best)


def decode_grasp(
    workspace: Workspace,
    gripper: Gripper,
    index: tuple[int, ...],
    quaternion_xyzw: Float[np.ndarray, " 4"],
    width: float,
    score: float,
) -> Grasp:
    """The grasp in the workspace frame whose grasp point is the centre of voxel `index`; width in metres."""
    pose = from_quaternion(quaternion_xyzw, workspace.position_of(index))
    return Grasp(pose, width, score).advanced(gripper.tcp_depth)


def encode_grasp(
    workspace: Workspace, gripper: Gripper, grasp: Grasp
) -> tuple[Int64[np.ndarray, " 3"], Float64[np.ndarray, " 4"], float]:
    """The inverse of `decode_grasp`: voxel index of the grasp point, quaternion xyzw, width in voxels."""
    point = grasp.advanced(-gripper.tcp_depth).position
    return workspace.index_of(point), to_quaternion(grasp.pose), grasp.width / workspace.voxel_size
