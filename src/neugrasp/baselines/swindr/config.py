"""The sizes of the network."""

from __future__ import annotations

from dataclasses import dataclass

from neugrasp.model.config import NetworkConfig


@dataclass(frozen=True, kw_only=True)
class SwinConfig(NetworkConfig):
    """4.6 M parameters; the original, in brackets, has 160 M. `image_size` is a multiple of 32."""

    width: int = 24
    """Channels of a branch's first stage, doubled from each of the four stages to the next (96)."""
    depths: tuple[int, int, int, int] = (2, 2, 2, 2)
    """Blocks of each stage (2, 2, 6, 2)."""
    heads: tuple[int, int, int, int] = (2, 4, 8, 8)
    """Heads of attention (3, 6, 12, 24)."""
    window: int = 8
    """Edge of the windows of attention, in tokens of 4 pixels at the first stage (7)."""
    decoder_width: int = 32
    """Channels of the two decoders (512)."""
    nearest: float = 0.2
    farthest: float = 0.8
    """z-depths in metres that the network's scale runs between; nothing beyond is handed on."""
