"""A radiance field: density and colour of points in a box, with proposals of where along a ray to look."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor, nn

from neugrasp.baselines.nerf.hash_grid import HashGrid
from neugrasp.baselines.nerf.histograms import resampled, weights_of

MOST = 12.0
"""Largest value of the logarithm of a density, which keeps a first wild step finite."""


@dataclass(frozen=True, kw_only=True)
class FieldConfig:
    """Sizes, chosen for a minute on two cores (`benchmarks/nerf_curve.py`); Nerfacto's stand beside them."""

    levels: int = 8
    """16"""
    log2_entries: int = 15
    """19"""
    coarsest: int = 16
    finest: int = 256
    """2048"""
    hidden: int = 64
    geometry: int = 15
    """Numbers that the density's network hands to the colour's."""
    proposal_samples: tuple[int, ...] = (48,)
    """Samples of each proposal network along a ray; 256, 96"""
    proposal_finest: tuple[int, ...] = (128,)
    """128, 256"""
    samples: int = 24
    """Samples of the field along a ray; 48"""


@dataclass(frozen=True)
class RayBundle:
    """Rays p = origin + z * direction, whose parameter is the z-depth in metres."""

    origins: Tensor
    """(r, 3), workspace frame."""
    directions: Tensor
    """(r, 3), of unit camera z."""
    near: Tensor
    """(r,) z-depths at which the ray enters and leaves the box."""
    far: Tensor

    def edges_at(self, parts: Tensor) -> Tensor:
        """z-depths of parts (r, n) of the way through the box."""
        return self.near[:, None] + parts * (self.far - self.near)[:, None]


@dataclass(frozen=True)
class Seen:
    """A histogram along each ray."""

    parts: Tensor
    """(r, n + 1) edges, as parts of the way through the box."""
    depths: Tensor
    """(r, n + 1) the same as z-depths."""
    weights: Tensor
    """(r, n)"""

    @property
    def middles(self) -> Tensor:
        """(r, n) z-depths of the intervals' middles."""
        return (self.depths[:, 1:] + self.depths[:, :-1]) / 2

    @property
    def opacity(self) -> Tensor:
        """(r,) in [0, 1]: how much of the light comes from the box."""
        return self.weights.sum(-1)

    @property
    def depth(self) -> Tensor:
        """(r,) expected z-depth of what light comes from the box."""
        return (self.weights * self.middles).sum(-1) / self.opacity.clamp(min=1e-6)


class RadianceField(nn.Module):
    """Nerfacto without contraction and appearances: a box of `size` metres from `origin`."""

    origin: Tensor
    size: Tensor

    def __init__(self, config: FieldConfig, origin: Tensor, size: Tensor):
        super().__init__()
        self.config = config
        self.register_buffer("origin", origin)
        self.register_buffer("size", size)
        self.grid = HashGrid(config.levels, 2, config.log2_entries, config.coarsest, config.finest)
        self.density = _mlp(self.grid.width, config.hidden, 1 + config.geometry)
        self.colour = _mlp(config.geometry + 16, config.hidden, 3, depth=2)
        self.proposals = nn.ModuleList(
            _Proposal(finest, min(15, config.log2_entries)) for finest in config.proposal_finest
        )

    def forward(
        self, rays: RayBundle, anneal: float = 1.0, generator: torch.Generator | None = None
    ) -> tuple[Tensor, list[Seen]]:
        """Colours (r, 3) and the histograms of the proposals, then the field's. A generator jitters samples.

        `anneal` in (0, 1] flattens proposals that samples are drawn from, while they know little.
        """
        parts = torch.linspace(0, 1, self.config.proposal_samples[0] + 1).to(rays.origins)
        parts = parts.expand(len(rays.origins), -1)
        if generator is not None:
            uniform = torch.ones_like(parts[:, 1:])
            parts = resampled(parts, uniform, parts.shape[1] - 1, generator)
        found: list[Seen] = []
        for proposal, num in zip(
            self.proposals, (*self.config.proposal_samples[1:], self.config.samples), strict=True
        ):
            seen, _ = self._seen(rays, parts, proposal)
            found.append(seen)
            parts = resampled(parts, seen.weights.detach() ** anneal, num, generator).detach()
        seen, features = self._seen(rays, parts, None)
        colour = self._colours(rays, features)
        found.append(seen)
        return (seen.weights[..., None] * colour).sum(1), found

    def _seen(self, rays: RayBundle, parts: Tensor, proposal: nn.Module | None) -> tuple[Seen, Tensor]:
        depths = rays.edges_at(parts)
        middles = (depths[:, 1:] + depths[:, :-1]) / 2
        points = rays.origins[:, None] + middles[..., None] * rays.directions[:, None]
        unit = ((points - self.origin) / self.size).clamp(0, 1).reshape(-1, 3)
        told = self.density(self.grid(unit)) if proposal is None else proposal(unit)
        told = told.reshape(*middles.shape, -1)
        lengths = (depths[:, 1:] - depths[:, :-1]) * rays.directions.norm(dim=-1, keepdim=True)
        weights = weights_of(torch.exp(told[..., 0].clamp(max=MOST)), lengths)
        return Seen(parts, depths, weights), told[..., 1:]

    def _colours(self, rays: RayBundle, features: Tensor) -> Tensor:
        towards = nn.functional.normalize(rays.directions, dim=-1)
        direction = harmonics(towards)[:, None].expand(-1, features.shape[1], -1)
        return torch.sigmoid(self.colour(torch.cat([features, direction], -1)))


class _Proposal(nn.Module):
    """A density that is cheap to ask."""

    def __init__(self, finest: int, log2_entries: int):
        super().__init__()
        self.grid = HashGrid(5, 2, log2_entries, 16, finest)
        self.density = _mlp(self.grid.width, 16, 1)

    def forward(self, unit: Tensor) -> Tensor:
        density: Tensor = self.density(self.grid(unit))
        return density


def _mlp(inputs: int, hidden: int, outputs: int, depth: int = 1) -> nn.Sequential:
    widths = [inputs, *[hidden] * depth]
    layers: list[nn.Module] = []
    for before, after in pairwise(widths):
        layers += [nn.Linear(before, after), nn.ReLU()]
    return nn.Sequential(*layers, nn.Linear(hidden, outputs))


def harmonics(directions: Tensor) -> Tensor:
    """Real spherical harmonics (n, 16) of degrees 0 to 3 of unit vectors (n, 3)."""
    x, y, z = directions.unbind(-1)
    xx, yy, zz = x * x, y * y, z * z
    values = [
        0.282095 * torch.ones_like(x),
        0.488603 * y, 0.488603 * z, 0.488603 * x,
        1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * zz - 1), 1.092548 * x * z,
        0.546274 * (xx - yy),
        0.590044 * y * (3 * xx - yy), 2.890611 * x * y * z, 0.457046 * y * (5 * zz - 1),
        0.373176 * z * (5 * zz - 3), 0.457046 * x * (5 * zz - 1), 1.445306 * z * (xx - yy),
        0.590044 * x * (xx - 3 * yy),
    ]  # fmt: skip
    return torch.stack(values, -1)
