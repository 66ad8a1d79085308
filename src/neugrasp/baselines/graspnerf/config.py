"""The sizes of GraspNeRF."""

from __future__ import annotations

from dataclasses import dataclass

from neugrasp.model.config import ModelConfig, NetworkConfig


@dataclass(frozen=True, kw_only=True)
class GraspNerfConfig(NetworkConfig):
    """Defaults are the widths of GraspNeRF's released code at this project's crop."""

    encoder_width: int = 32
    """Channels of the first stage of both encoders; the next two have 2 x and 4 x."""
    image_blocks: tuple[int, int, int] = (1, 2, 6)
    ray_blocks: tuple[int, int, int] = (2, 3, 6)
    feature_dim: int = 32
    """Channels of the image features, of the ray features and of what the aggregation makes of them."""
    hidden_dim: int = 64
    """Widest layer of the aggregation."""
    ray_dim: int = 16
    """Channels of a sample while the samples of a ray attend to one another; a multiple of `heads`."""
    heads: int = 4
    coarse_samples: int = 40
    fine_samples: int = 40
    nearest: float = 0.2
    """Depths in metres between which inverse depth is scaled to run from 0 to 1."""
    farthest: float = 0.8
    head_channels: tuple[int, int, int] = (16, 32, 64)
    """Channels of the grasp head's encoder (VGN's)."""

    def encoder(self, blocks: tuple[int, int, int]) -> ModelConfig:
        """What the project's image encoder is told."""
        return ModelConfig(
            image_size=self.image_size,
            encoder_width=self.encoder_width,
            encoder_blocks=blocks,
            feature_dim=self.feature_dim,
        )
