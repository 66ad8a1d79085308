"""Signed distances along rays -> colour, depth and opacity: the training signal (NeuS, discrete form)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from neugrasp.geometry.workspace import Workspace


@dataclass(frozen=True)
class Rays:
    """Rays of one camera, cut to the part inside the workspace."""

    origins: Float[Tensor, "rays 3"]
    """Metres."""
    directions: Float[Tensor, "rays 3"]
    """Unit vectors."""
    near: Float[Tensor, " rays"]
    """Metres along the ray."""
    far: Float[Tensor, " rays"]
    """Metres along the ray; a ray that misses the workspace has far <= near."""

    def points(self, distances: Float[Tensor, "rays samples"]) -> Float[Tensor, "rays samples 3"]:
        """Points at distances along the rays, metres."""
        return self.origins.unsqueeze(1) + distances.unsqueeze(-1) * self.directions.unsqueeze(1)

    def select(self, keep: Bool[Tensor, " rays"] | Int[Tensor, " kept"]) -> Rays:
        """Some of the rays, by mask or index."""
        return Rays(self.origins[keep], self.directions[keep], self.near[keep], self.far[keep])


@dataclass(frozen=True)
class Rendered:
    """What a camera would see along rays."""

    colour: Float[Tensor, "rays 3"]
    """RGB."""
    depth: Float[Tensor, " rays"]
    """Expected distance along the ray, metres; of what is opaque."""
    opacity: Float[Tensor, " rays"]
    """Accumulated weight in [0, 1]."""
    weights: Float[Tensor, "rays intervals"]
    """Weights of the intervals between samples."""
    midpoints: Float[Tensor, "rays intervals"]
    """Distances of the midpoints of the intervals, metres."""


def cut_to_workspace(
    origins: Float[Tensor, "rays 3"], directions: Float[Tensor, "rays 3"], workspace: Workspace
) -> Rays:
    """Rays limited to the cube, from 2 cm under the table upwards (slab test)."""
    low = origins.new_tensor([0.0, 0.0, workspace.table_height - 0.02])
    high = torch.full_like(low, workspace.size)
    safe = torch.where(directions.abs() < 1e-9, torch.full_like(directions, 1e-9), directions)
    first, second = (low - origins) / safe, (high - origins) / safe
    near = torch.minimum(first, second).amax(dim=1).clamp(min=0.02)
    far = torch.maximum(first, second).amin(dim=1)
    return Rays(origins, directions, near, far)


def neus_alpha(
    sdf: Float[Tensor, "rays samples"], sharpness: Float[Tensor, ""]
) -> Float[Tensor, "rays samples-1"]:
    """Opacity of the intervals between samples with signed distances in metres.

    alpha = max(0, (Phi(f_i) - Phi(f_i+1)) / Phi(f_i)) with Phi(f) = sigmoid(sharpness f): Eq. 13 of NeuS.
    `sharpness` is in 1 / metre.
    """
    occupancy = torch.sigmoid(sdf * sharpness)
    before, after = occupancy[:, :-1], occupancy[:, 1:]
    return ((before - after) / (before + 1e-6)).clamp(0, 1)


def ray_weights(
    sdf: Float[Tensor, "rays samples"], sharpness: Float[Tensor, ""]
) -> Float[Tensor, "rays samples-1"]:
    """Weight of each interval: its opacity times what gets through to it; sdf in metres."""
    alpha = neus_alpha(sdf, sharpness)
    through = torch.cumprod(1 - alpha + 1e-7, dim=1)
    transmittance = torch.cat([torch.ones_like(through[:, :1]), through[:, :-1]], dim=1)
    return alpha * transmittance


def composite(
    sdf: Float[Tensor, "rays samples"],
    colour: Float[Tensor, "rays samples 3"],
    distances: Float[Tensor, "rays samples"],
    sharpness: Float[Tensor, ""],
) -> Rendered:
    """Accumulates along rays: distances and sdf in metres."""
    weights = ray_weights(sdf, sharpness)
    midpoints = (distances[:, 1:] + distances[:, :-1]) / 2
    opacity = weights.sum(1)
    colours = (colour[:, 1:] + colour[:, :-1]) / 2
    rgb = (weights.unsqueeze(-1) * colours).sum(1)
    depth = (weights * midpoints).sum(1) / opacity.clamp(min=1e-6)
    return Rendered(rgb, depth, opacity, weights, midpoints)


def stratified_samples(
    rays: Rays, num: int, generator: torch.Generator | None
) -> Float[Tensor, "rays {num}"]:
    """Distances from near to far: evenly, or jittered within even strata if a generator is given."""
    count = len(rays.near)
    if generator is None:
        fractions = torch.linspace(0, 1, num, device=rays.near.device).expand(count, num)
    else:
        jitter = torch.rand((count, num), generator=generator).to(rays.near)
        fractions = (torch.arange(num, device=rays.near.device) + jitter) / num
    return rays.near.unsqueeze(1) + fractions * (rays.far - rays.near).unsqueeze(1)


def importance_samples(
    distances: Float[Tensor, "rays samples"],
    weights: Float[Tensor, "rays samples-1"],
    num: int,
    generator: torch.Generator | None,
) -> Float[Tensor, "rays {num}"]:
    """New sorted distances where the weights of the intervals lie (inverse CDF)."""
    density = weights.detach() + 1e-3
    cdf = torch.cumsum(density / density.sum(1, keepdim=True), dim=1)
    cdf = torch.cat([torch.zeros_like(cdf[:, :1]), cdf], dim=1)
    even = (torch.arange(num, device=cdf.device) + 0.5) / num
    if generator is not None:
        even = (even + (torch.rand((len(cdf), num), generator=generator).to(cdf) - 0.5) / num).clamp(0, 1)
    u = even.expand(len(cdf), num).contiguous()
    upper = torch.searchsorted(cdf, u, right=True).clamp(1, cdf.shape[1] - 1)
    low_cdf, high_cdf = cdf.gather(1, upper - 1), cdf.gather(1, upper)
    fraction = (u - low_cdf) / (high_cdf - low_cdf).clamp(min=1e-9)
    start, end = distances.gather(1, upper - 1), distances.gather(1, upper)
    return start + fraction * (end - start)
