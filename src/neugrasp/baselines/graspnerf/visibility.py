"""Where the rays of a photo end: a mixture of two logistics over inverse depth (NeuRay, CVPR 2022)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

LEAST_STEEPNESS = 0.05
"""So that no mixture is so wide that its gradient vanishes."""


@dataclass(frozen=True)
class RayEnds:
    """Distributions, one per point and view, of the place where the ray through the point ends.

    Places are inverse depths scaled to run from 0 at the nearest to 1 at the farthest depth.
    """

    means: Tensor
    """(..., 2)"""
    steepness: Tensor
    """(..., 2) inverse of the logistics' scale."""
    shares: Tensor
    """(..., 2) they sum to one."""

    @property
    def mean(self) -> Tensor:
        """(...) the expected place."""
        return (self.shares * self.means).sum(-1)

    def before(self, places: Tensor) -> Tensor:
        """(...) the probability that the ray ends before the places (...)."""
        at = torch.sigmoid((places.unsqueeze(-1) - self.means) * self.steepness)
        return (self.shares * at).sum(-1)

    def seen_and_hit(self, places: Tensor, lengths: Tensor) -> tuple[Tensor, Tensor]:
        """The probabilities (...) that intervals about the places (...) are reached, and that rays end there.

        Both lie in [0, 1], and a ray ends in no interval that it does not reach.
        """
        start, end = self.before(places - lengths / 2), self.before(places + lengths / 2)
        return 1 - start, end - start


def _layers(dim: int, dim_out: int) -> nn.Sequential:
    return nn.Sequential(
        nn.Linear(dim, dim), nn.ELU(), nn.Linear(dim, dim), nn.ELU(), nn.Linear(dim, dim_out)
    )


class RayEndDecoder(nn.Module):
    """Ray features (..., d) to the distributions that they stand for."""

    def __init__(self, dim: int):
        super().__init__()
        self.means, self.steepness, self.share = _layers(dim, 2), _layers(dim, 2), _layers(dim, 1)

    def forward(self, features: Tensor) -> RayEnds:
        """One distribution for each."""
        share = torch.sigmoid(self.share(features).float())
        return RayEnds(
            nn.functional.softplus(self.means(features).float()),
            # Twice: the original writes the logistic as a hyperbolic tangent of half its argument.
            2 * (nn.functional.softplus(self.steepness(features).float()) + LEAST_STEEPNESS),
            torch.cat([share, 1 - share], dim=-1),
        )


def scaled_inverse(depth: Tensor, nearest: float, farthest: float) -> Tensor:
    """Inverse depth on the scale of `RayEnds`: 0 at `nearest`, 1 at `farthest`; depths in metres."""
    return (1 / nearest - 1 / depth.clamp(min=1e-3)) / (1 / nearest - 1 / farthest)


def scaled_length(length: Tensor, depth: Tensor, nearest: float, farthest: float) -> Tensor:
    """How long an interval of `length` metres about a depth is on that scale."""
    return length / depth.clamp(min=1e-3).square() / (1 / nearest - 1 / farthest)
