"""Normalisation of maps and volumes whose channels lie last in memory."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor, nn

SMALL = 1024
"""Pixels or voxels from which on PyTorch normalises fast where channels lie last."""


class GroupNorm(nn.GroupNorm):
    """Instance normalisation with as many groups as channels; it keeps no statistics, so one scene is enough.

    Where channels lie last, PyTorch's gradient is ten times as slow as where they come first, small maps are,
    and the variance is a difference of two sums, which costs three digits: none that bfloat16 had.
    """

    def forward(self, x: Tensor) -> Tensor:
        """The same shape (b, c, ...), and the same order in memory."""
        if x.dtype == torch.bfloat16 and x[0, 0].numel() >= SMALL and not torch.is_grad_enabled():
            return super().forward(x)
        last = torch.channels_last if x.dim() == 4 else torch.channels_last_3d
        return super().forward(x.contiguous()).contiguous(memory_format=last)


class PixelNorm(nn.LayerNorm):
    """Layer normalisation over the channels of each pixel of maps (n, c, h, w)."""

    def forward(self, x: Tensor) -> Tensor:
        """The same shape and the same order in memory."""
        pixels = x.permute(0, 2, 3, 1)
        normed = F.layer_norm(pixels, self.normalized_shape, self.weight, self.bias, self.eps)
        return normed.permute(0, 3, 1, 2)
