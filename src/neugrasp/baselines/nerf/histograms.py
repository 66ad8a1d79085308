"""Histograms along rays: drawing samples from one, and what binds those of proposals to the field's.

A histogram of r rays has edges (r, n + 1), rising, and weights (r, n) that sum to at most 1.
"""

from __future__ import annotations

import torch
from torch import Tensor

PADDING = 0.01
"""Added to every weight before samples are drawn, so that no interval is never looked at."""
TINY = 1e-7


def weights_of(density: Tensor, lengths: Tensor) -> Tensor:
    """The share of light (r, n) that comes from each interval, of density (r, n) in 1 / m and length in m."""
    optical = density * lengths
    before = torch.cumsum(optical, -1) - optical
    return torch.exp(-before) * (1 - torch.exp(-optical))


def resampled(edges: Tensor, weights: Tensor, num: int, generator: torch.Generator | None) -> Tensor:
    """Edges (r, num + 1) of intervals that hold equal shares of the histogram; jittered with a generator."""
    padded = weights + PADDING
    share = torch.cumsum(padded / padded.sum(-1, keepdim=True), -1)
    below = torch.cat([torch.zeros_like(share[:, :1]), share], -1)
    u = torch.linspace(0, 1, num + 1).expand(len(edges), -1)
    if generator is not None:
        jitter = (torch.rand(u.shape, generator=generator) - 0.5) / num
        u = (u + jitter).clamp(0, 1)
    u = u.to(edges).contiguous()
    at = torch.searchsorted(below.contiguous(), u, right=True).clamp(1, weights.shape[1])
    low, high = below.gather(1, at - 1), below.gather(1, at)
    part = ((u - low) / (high - low).clamp(min=TINY)).clamp(0, 1)
    left, right = edges.gather(1, at - 1), edges.gather(1, at)
    return left + part * (right - left)


def interlevel_loss(edges: Tensor, weights: Tensor, other_edges: Tensor, other_weights: Tensor) -> Tensor:
    """What a proposal fails to bound of a histogram (mip-NeRF 360, eq. 13); only the proposal learns.

    0 where in every interval the proposal's weights of all that overlaps it sum to at least the histogram's.
    """
    edges, weights = edges.detach(), weights.detach()
    total = torch.cat([torch.zeros_like(other_weights[:, :1]), torch.cumsum(other_weights, -1)], -1)
    last = other_weights.shape[1]
    fences = other_edges.detach().contiguous()
    first = torch.searchsorted(fences, edges[:, :-1].contiguous(), right=True) - 1
    end = torch.searchsorted(fences, edges[:, 1:].contiguous())
    bound = total.gather(1, end.clamp(0, last)) - total.gather(1, first.clamp(0, last))
    return ((weights - bound).clamp(min=0) ** 2 / (weights + TINY)).sum(-1).mean()


def distortion_loss(edges: Tensor, weights: Tensor) -> Tensor:
    """How far apart a ray's weights lie (mip-NeRF 360, eq. 15), of edges in [0, 1]; 0 for a single spike."""
    middles, widths = (edges[:, 1:] + edges[:, :-1]) / 2, edges[:, 1:] - edges[:, :-1]
    apart = (middles[:, :, None] - middles[:, None]).abs()
    between = (weights[:, :, None] * weights[:, None] * apart).sum((1, 2))
    return (between + (weights**2 * widths).sum(-1) / 3).mean()


def depth_loss(edges: Tensor, weights: Tensor, depth: Tensor, spread: float) -> Tensor:
    """DS-NeRF's: the weights should be a bell of `spread` metres about the depth (r,); edges in metres."""
    middles, widths = (edges[:, 1:] + edges[:, :-1]) / 2, edges[:, 1:] - edges[:, :-1]
    bell = torch.exp(-((middles - depth[:, None]) ** 2) / (2 * spread**2)) * widths
    return -(torch.log(weights + TINY) * bell / bell.sum(-1, keepdim=True).clamp(min=TINY)).sum(-1).mean()
