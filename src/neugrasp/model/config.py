"""The sizes and switches of the network."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class NetworkConfig:
    """What every network that is trained here says of itself; its own sizes and switches come below."""

    image_size: int = 256
    """Edge of the square crop the network sees; a multiple of 16."""


@dataclass(frozen=True, kw_only=True)
class ModelConfig(NetworkConfig):
    """Defaults are the paper's shapes (Fig. 2, and its released code) at a 256 x 256 crop."""

    encoder_width: int = 32
    """Channels of the first stage; the next two have 2 x and 4 x."""
    encoder_blocks: tuple[int, int, int] = (2, 3, 6)
    feature_dim: int = 32
    volume_dim: int = 16
    volume_hidden: tuple[int, int, int, int] = (16, 16, 32, 48)
    """Channels of the 3D U-Net at 40, 20, 10 and 5 voxels."""
    heads: int = 8
    fusion_hidden: int = 80
    fused_dim: int = 64
    coarse_samples: int = 40
    fine_samples: int = 40
    head_channels: tuple[int, int, int] = (16, 32, 64)
    """Channels of the grasp head's encoder (VGN's)."""
    use_residual_attention: bool = True
    """Eq. 7. False is the ablation "w/o f_attn": scene features take its place."""
    use_change: bool = False
    """Whether the residual branch also gets features of the photos' own differences; not in the paper."""
    use_occupancy_prior: bool = True
    """False is the ablation "w/o V_occ": the residual branch gets no volume."""
    use_backgrounds: bool = True
    """False is the ablation "w/o backgrounds": no residual branch at all."""
    learned_sharpness: bool = False
    """Whether the NeuS sharpness is a parameter (the paper) or follows a schedule."""

    @property
    def token_dims(self) -> tuple[int, ...]:
        """Width of the view tokens of each branch: source, then residual where there is one."""
        source = self.feature_dim + self.volume_dim
        if not self.use_backgrounds:
            return (source,)
        return (source, source if self.use_occupancy_prior else self.feature_dim)
