"""Photos -> image features, and ray features that say where the rays of each photo end."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.model.features import FeatureNet, ReflectedConv, ResidualBlock


class Encoders(nn.Module):
    """Two Res U-Nets; the features of the first, and what a third, small network makes of both (NeuRay)."""

    def __init__(self, config: GraspNerfConfig):
        super().__init__()
        dim = config.feature_dim
        self.images = FeatureNet(config.encoder(config.image_blocks))
        self.rays = nn.Sequential(
            FeatureNet(config.encoder(config.ray_blocks)),
            ReflectedConv(dim, dim),
            ResidualBlock(dim, dim, stride=1),
            nn.Conv2d(dim, dim, 1),
        )
        self.visibility = nn.Sequential(
            ReflectedConv(2 * dim, dim),
            ResidualBlock(dim, dim, stride=1),
            ResidualBlock(dim, dim, stride=1),
            nn.Conv2d(dim, dim, 1),
        )

    def forward(self, images: Tensor) -> Tensor:
        """Image features, then ray features (n, 2 d, s / 4, s / 4) of photos (n, 3, s, s) in [0, 1]."""
        features = self.images(images)
        rays = self.visibility(torch.cat([self.rays(images), features], dim=1))
        return torch.cat([features, rays], dim=1)
