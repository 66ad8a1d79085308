"""truth.npz: what a simulator knows of a scene's surface and of its input views."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.grasp_scene import SceneTruth
from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.errors import InputError

DEPTH_UNIT = 1e-4
"""Metres that one step of a stored depth stands for; 0 is no surface."""
TRUTH_ARRAYS = {"tsdf": "f", "observed": "u", "depth": "u", "masks": "i", "distance": "f"}
"""Arrays of truth.npz and their kinds (`npz_arrays`); older records lack the distance."""


def truth_to_bytes(truth: SceneTruth, depths: NDArray[np.float32], masks: NDArray[np.int8]) -> bytes:
    """Grids, and depths and masks (n, s, s) of the input views, as a compressed npz."""
    depth = np.where(np.isfinite(depths) & (depths > 0), depths / DEPTH_UNIT, 0)
    return npz_bytes(
        tsdf=truth.tsdf.astype(np.float16),
        observed=np.packbits(truth.observed),
        depth=np.clip(np.round(depth), 0, 65535).astype(np.uint16),
        masks=masks.astype(np.int8),
        **({} if truth.distance is None else {"distance": truth.distance.astype(np.float16)}),
    )


def truth_from_bytes(data: bytes, source: str) -> dict[str, Any]:
    """The fields tsdf, observed, depths, masks and distance of a `Record`. Raises `InputError`."""
    arrays = npz_arrays(data, TRUTH_ARRAYS, source, optional=("distance",))
    bits = np.unpackbits(arrays["observed"])[: arrays["tsdf"].size].astype(bool)
    if bits.size != arrays["tsdf"].size:
        raise InputError(f"{source}: 'observed' has {bits.size} voxels, 'tsdf' {arrays['tsdf'].size}")
    return {
        "tsdf": arrays["tsdf"].astype(np.float32),
        "observed": bits.reshape(arrays["tsdf"].shape),
        "depths": arrays["depth"].astype(np.float32) * np.float32(DEPTH_UNIT),
        "masks": arrays["masks"],
        "distance": arrays["distance"].astype(np.float32) if "distance" in arrays else None,
    }
