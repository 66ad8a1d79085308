"""Feature maps -> prior volumes: what the views agree on at each voxel, made smooth by a 3D U-Net."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from einops import rearrange
from jaxtyping import Bool, Float
from torch import Tensor, nn

from neugrasp.geometry.sampling import InterpolationIndex, LookupTable
from neugrasp.model.chunked import map_chunked
from neugrasp.model.config import ModelConfig
from neugrasp.model.norm import GroupNorm


def masked_mean_and_variance(
    features: Float[Tensor, "views points channels"], seen: Bool[Tensor, "views points"]
) -> tuple[Float[Tensor, "points channels"], Float[Tensor, "points channels"]]:
    """Mean and variance over the views of features where `seen`; 0 where none is."""
    weights = (seen / seen.sum(0, keepdim=True).clamp(min=1)).unsqueeze(-1)
    mean = (weights * features).sum(0)
    return mean, (weights * (features - mean).square()).sum(0)


def _block(channels_in: int, channels_out: int, stride: int = 1) -> nn.Sequential:
    return nn.Sequential(
        nn.Conv3d(channels_in, channels_out, 3, stride, 1, bias=False),
        GroupNorm(max(1, channels_out // 8), channels_out),
        nn.ReLU(),
    )


class _Up(nn.Module):
    """Doubles the resolution and adds the skip, without the pattern that transposed convolutions print."""

    def __init__(self, channels_in: int, channels_out: int):
        super().__init__()
        self.body = _block(channels_in, channels_out)

    def forward(self, x: Tensor, skip: Tensor) -> Tensor:
        up: Tensor = self.body(F.interpolate(x, scale_factor=2.0, mode="nearest"))
        return up + skip


class VolumeNet(nn.Module):
    """Per-view features at the voxels -> a prior volume.

    The paper's network with group normalisation in place of batch normalisation (a step sees one scene, and
    both priors go through the same weights) and nearest upsampling in place of transposed convolutions.
    """

    def __init__(self, config: ModelConfig):
        super().__init__()
        dim, volume = config.feature_dim, config.volume_dim
        a, b, c, d = config.volume_hidden
        self.reduce = nn.Sequential(
            nn.Linear(dim, dim), nn.ReLU(), nn.Linear(dim, volume), nn.ReLU(), nn.Linear(volume, volume // 2)
        )
        self.enter = _block(2 * (volume // 2), a)
        self.down1 = nn.Sequential(_block(a, b, 2), _block(b, b))
        self.down2 = nn.Sequential(_block(b, c, 2), _block(c, c))
        self.down3 = nn.Sequential(_block(c, d, 2), _block(d, d))
        self.up3, self.up2, self.up1 = _Up(d, c), _Up(c, b), _Up(b, a)
        self.out = nn.Conv3d(a, volume, 3, 1, 1)

    def forward(
        self,
        maps: tuple[Float[Tensor, "views channels height width"], ...],
        voxels: InterpolationIndex,
        seen: Bool[Tensor, "views voxels"],
    ) -> Float[Tensor, "{len(maps)} out r r r"]:
        """Volumes, one for each of the maps.

        `voxels` (views, voxels) are the places of the voxels [x, y, z] in the maps.
        """
        # A linear layer and an interpolation may change places, and pixels are fewer than voxels.
        first, *others = self.reduce
        rows = [first(one.movedim(1, -1)).flatten(0, 2).float() for one in maps]
        tables, rest = [LookupTable.of(one) for one in rows], nn.Sequential(*others)

        def summaries(part: slice) -> tuple[Tensor, ...]:
            places = voxels.part(part)
            features = [rest(places.read(table)) for table in tables]
            return tuple(torch.cat(masked_mean_and_variance(one, seen[:, part]), -1) for one in features)

        num = seen.shape[1]
        x = torch.stack(map_chunked(summaries, num, 1, seen.device))
        edge = round(num ** (1 / 3))
        x0 = self.enter(rearrange(x, "k (x y z) c -> k c x y z", x=edge, y=edge))
        x1 = self.down1(x0)
        x2 = self.down2(x1)
        x3 = self.down3(x2)
        volumes: Tensor = self.out(self.up1(self.up2(self.up3(x3, x2), x1), x0))
        return volumes
