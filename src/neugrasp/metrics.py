"""Numbers that judge a reconstruction, a rendering or a grasp volume."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from skimage.metrics import structural_similarity

Grid = Float[np.ndarray, "r r r"]
Image = Float[np.ndarray, "height width 3"]

L1_MASKS = (1.0, 0.5, 0.3, 0.1, 0.05)
"""Depths a of the masks -a < truth < 0.1; 0.3 is the headline (docs/reproduction.md)."""
CONSTANTS = (-1.0, 0.0, 1.0)
"""Predictors that know nothing, printed beside every L1."""


def l1_by_mask(predicted: Grid | float, truth: Grid) -> dict[str, float]:
    """Mean absolute error of a TSDF, in truncation units, under each mask -a < truth < 0.1; key str(a).

    NaN where no voxel of the truth lies in a mask: an object so thin that none is near its surface inside.
    """
    error = np.abs(predicted - truth)
    masked = {str(a): error[(truth > -a) & (truth < 0.1)] for a in L1_MASKS}
    return {name: float(values.mean()) if values.size else float("nan") for name, values in masked.items()}


def occupancy_iou(predicted: Grid, truth: Grid, above: int) -> float:
    """Intersection over union of the insides (value < 0) of two TSDFs, from voxel layer `above` upwards.

    1 where both are empty.
    """
    inside, true_inside = predicted[:, :, above:] < 0, truth[:, :, above:] < 0
    union = np.count_nonzero(inside | true_inside)
    return np.count_nonzero(inside & true_inside) / union if union else 1.0


def volume_ratio(predicted: Grid, truth: Grid, above: int) -> float:
    """Voxels inside (value < 0) of the first grid over those of the second, from layer `above` upwards."""
    inside, true_inside = (np.count_nonzero(grid[:, :, above:] < 0) for grid in (predicted, truth))
    return inside / max(1, true_inside)


def psnr(image: Image, truth: Image) -> float:
    """Peak signal-to-noise ratio in dB of images in [0, 1]."""
    return float(-10 * np.log10(max(np.mean((image - truth) ** 2), 1e-10)))


def ssim(image: Image, truth: Image) -> float:
    """Structural similarity of images in [0, 1]."""
    return float(structural_similarity(image, truth, channel_axis=2, data_range=1.0))


def area_under_roc(scores: Float[np.ndarray, " n"], success: Bool[np.ndarray, " n"]) -> float:
    """Probability that a success scores higher than a failure, ties half; NaN without both."""
    positives, negatives = scores[success], scores[~success]
    if len(positives) == 0 or len(negatives) == 0:
        return float("nan")
    ordered = np.sort(negatives)
    wins = np.searchsorted(ordered, positives, side="left") + np.searchsorted(
        ordered, positives, side="right"
    )
    return float(wins.mean() / 2 / len(negatives))


def wilson_interval(successes: int, trials: int, z: float = 1.959964) -> tuple[float, float]:
    """The 95 % Wilson score interval of a rate, as two rates; (0, 1) without trials."""
    if trials == 0:
        return (0.0, 1.0)
    rate, spread = successes / trials, z * z / trials
    centre = (rate + spread / 2) / (1 + spread)
    half = z / (1 + spread) * np.sqrt(rate * (1 - rate) / trials + spread / (4 * trials))
    return (max(0.0, float(centre - half)), min(1.0, float(centre + half)))
