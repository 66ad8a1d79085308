"""What the views show at points of rays -> signed distance and colour (IBRNet, with NeuRay's visibility)."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.field import position_encoding

POSITION_DIM = 21
DIRECTION_DIM = 4


@dataclass(frozen=True)
class ViewedPoints:
    """Points along r rays, s each, and what n views show there."""

    points: Tensor
    """(r, s, 3) workspace metres."""
    colours: Tensor
    """(n, r s, 3) of the photos."""
    features: Tensor
    """(n, r s, d) image features."""
    rays: Tensor
    """(n, r s, d) ray features, with what they say of visibility and of a surface here."""
    directions: Tensor
    """(n, r s, 4): how the view's direction differs from the one looked along, and their cosine."""
    seen: Tensor
    """(n, r s) bool."""

    @property
    def num_seen(self) -> Tensor:
        """(r, s) how many views see each point."""
        return self.seen.sum(0).reshape(self.points.shape[:2])


def weighted_moments(values: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Mean and variance (p, c) over the views of values (n, p, c), weights (n, p, 1) that sum to one."""
    mean = (weights * values).sum(0)
    return mean, (weights * (values - mean).square()).sum(0)


def _shared(weights: Tensor) -> Tensor:
    """Weights (n, p, 1) as shares of their sum; all 0 where that is 0."""
    return weights / (weights.sum(0, keepdim=True) + 1e-8)


class RayAttention(nn.Module):
    """The samples of a ray attend to one another; a residual, normalised, and nothing after it."""

    def __init__(self, dim: int, heads: int):
        super().__init__()
        self.heads = heads
        self.joint = nn.Linear(dim, 3 * dim, bias=False)
        self.merge = nn.Linear(dim, dim, bias=False)
        self.norm = nn.LayerNorm(dim)

    def forward(self, x: Tensor, told: Tensor) -> Tensor:
        """Same shape as x (r, s, d); samples that are not `told` (r, s) hear nothing of the others."""
        split = self.joint(x).unflatten(-1, (3, self.heads, -1)).permute(2, 0, 3, 1, 4)
        heard = F.scaled_dot_product_attention(*split.unbind(0)).transpose(1, 2).flatten(2)
        return self.norm(x + self.merge(heard) * told.unsqueeze(-1))


class Aggregation(nn.Module):
    """Signed distance and colour of points. The order of the views does not matter."""

    def __init__(self, config: GraspNerfConfig):
        super().__init__()
        dim, hidden, ray = config.feature_dim, config.hidden_dim, config.ray_dim
        shown = 3 + dim
        self.directions = nn.Sequential(
            nn.Linear(DIRECTION_DIM, ray), nn.ELU(), nn.Linear(ray, shown), nn.ELU()
        )
        self.rays = nn.Sequential(nn.Linear(dim + 2, dim), nn.ReLU(), nn.Linear(dim, dim))
        self.trust = nn.Sequential(nn.Linear(dim, 8), nn.ELU(), nn.Linear(8, 1))
        # The first layer of one network: a product with what all views share, and one with what each shows.
        self.of_all = nn.Linear(4 * shown, hidden)
        self.of_each = nn.Linear(shown + dim, hidden, bias=False)
        self.base = nn.Sequential(nn.ELU(), nn.Linear(hidden, dim), nn.ELU())
        self.weigh = nn.Sequential(nn.Linear(dim, dim), nn.ELU(), nn.Linear(dim, dim + 1), nn.ELU())
        self.weigh_again = nn.Sequential(nn.Linear(dim, dim), nn.ELU(), nn.Linear(dim, 1))
        self.geometry = nn.Sequential(
            nn.Linear(2 * dim + 1 + POSITION_DIM, hidden), nn.ELU(), nn.Linear(hidden, ray), nn.ELU()
        )
        self.attention = RayAttention(ray, config.heads)
        self.distance = nn.Sequential(nn.Linear(ray, ray), nn.ELU(), nn.Linear(ray, 1))
        self.blending = nn.Sequential(
            nn.Linear(dim + 1 + DIRECTION_DIM, 16), nn.ELU(), nn.Linear(16, 8), nn.ELU(), nn.Linear(8, 1)
        )

    def forward(self, at: ViewedPoints, workspace: Workspace, order: Tensor) -> tuple[Tensor, Tensor]:
        """Signed distance (r, s), + outside, in truncation units and not clipped, and colour (r, s, 3).

        `order` (s, d) encodes the place of a sample on its ray.
        """
        seen = at.seen.unsqueeze(-1)
        each, visible = self._each_view(at, seen)
        shares = _shared(visible)
        mean, variance = weighted_moments(each, shares)
        # The original takes metres, in which the table is a step that takes long to learn.
        place = position_encoding(workspace.to_unit(at.points.flatten(0, 1)))
        told = [mean, variance, shares.mean(0), place]
        x = self.geometry(torch.cat(told, dim=-1)).unflatten(0, at.points.shape[:2])
        x = self.attention(x + order.to(x.dtype), at.num_seen > 1)
        sdf = self.distance(x).squeeze(-1).float()
        sdf = torch.where(at.num_seen > 0, sdf, torch.ones_like(sdf))
        blend = self.blending(torch.cat([each, visible, at.directions.to(each.dtype)], dim=-1)).float()
        weights = torch.softmax(blend.masked_fill(~seen, -1e9), dim=0)
        return sdf, (weights * at.colours).sum(0).reshape(at.points.shape)

    def _each_view(self, at: ViewedPoints, seen: Tensor) -> tuple[Tensor, Tensor]:
        """Features (n, p, d) of each view that know of the others, and how visible the point is in it."""
        shown = torch.cat([at.colours, at.features], dim=-1) + self.directions(at.directions)
        rays = self.rays(at.rays)
        trusted = _shared(torch.sigmoid(self.trust(rays)) * seen)
        plain = _shared(seen.to(shown.dtype))
        shared = torch.cat([*weighted_moments(shown, trusted), *weighted_moments(shown, plain)], dim=-1)
        x = self.base(self.of_all(shared) + self.of_each(torch.cat([shown, rays], dim=-1)))
        more, visible = self.weigh(x * plain).split([x.shape[-1], 1], dim=-1)
        x = x + more
        visible = torch.sigmoid(visible) * seen
        return x, torch.sigmoid(self.weigh_again(x * visible)) * seen
