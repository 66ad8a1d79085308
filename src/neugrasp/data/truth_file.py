"""truth.npz of a record: grids, exact and measured depth, masks."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.data.grasp_scene import SceneTruth
from neugrasp.data.npz import npz_arrays, npz_bytes
from neugrasp.errors import InputError

DEPTH_UNIT = 1e-4
"""Metres that one step of a stored depth stands for; 0 is no surface."""
TRUTH_ARRAYS = {
    "tsdf": "f", "observed": "u", "depth": "u", "masks": "i", "distance": "f", "stereo": "u", "fused": "f",
}  # fmt: skip
OPTIONAL = ("distance", "stereo", "fused")
"""Arrays of truth.npz and their kinds (`npz_arrays`). Older records lack the distance; stereo and fused are
there where they were asked for."""


def truth_to_bytes(truth: SceneTruth, stereo: NDArray[np.float32] | None = None) -> bytes:
    """Grids, depths and masks as a compressed npz, and what a stereo sensor measured."""
    none = np.zeros((0, 0, 0), np.float32)
    return npz_bytes(
        tsdf=truth.tsdf.astype(np.float16),
        observed=np.packbits(truth.observed),
        depth=_depth_steps(none if truth.depths is None else truth.depths),
        masks=(none if truth.masks is None else truth.masks).astype(np.int8),
        **({} if truth.distance is None else {"distance": truth.distance.astype(np.float16)}),
        **({} if stereo is None else {"stereo": _depth_steps(stereo)}),
        **({} if truth.fused is None else {"fused": truth.fused.astype(np.float16)}),
    )


def _depth_steps(depths: NDArray[np.float32]) -> NDArray[np.uint16]:
    """Depths in steps of `DEPTH_UNIT`, 0 where there is none."""
    known = np.where(np.isfinite(depths) & (depths > 0), depths / DEPTH_UNIT, 0)
    return np.clip(np.round(known), 0, 65535).astype(np.uint16)


def _metres(steps: NDArray[np.uint16]) -> NDArray[np.float32]:
    return steps.astype(np.float32) * np.float32(DEPTH_UNIT)


def truth_from_bytes(data: bytes, source: str) -> dict[str, Any]:
    """The fields tsdf, observed, depths, masks, distance, stereo and fused of a `Record`.

    Raises `InputError` where the file is damaged.
    """
    arrays = npz_arrays(data, TRUTH_ARRAYS, source, optional=OPTIONAL)
    bits = np.unpackbits(arrays["observed"])[: arrays["tsdf"].size].astype(bool)
    if bits.size != arrays["tsdf"].size:
        raise InputError(f"{source}: 'observed' has {bits.size} voxels, 'tsdf' {arrays['tsdf'].size}")
    return {
        "tsdf": arrays["tsdf"].astype(np.float32),
        "observed": bits.reshape(arrays["tsdf"].shape),
        "depths": _metres(arrays["depth"]),
        "masks": arrays["masks"],
        "distance": arrays["distance"].astype(np.float32) if "distance" in arrays else None,
        "stereo": _metres(arrays["stereo"]) if "stereo" in arrays else None,
        "fused": arrays["fused"].astype(np.float32) if "fused" in arrays else None,
    }
