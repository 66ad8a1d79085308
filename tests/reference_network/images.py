"""Maps read at pixels with PyTorch's own sampling, which the package does without."""

from __future__ import annotations

import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor


def sample_images(
    maps: Float[Tensor, "views channels height width"],
    pixels: Float[Tensor, "views points 2"],
    size: tuple[int, int],
) -> Float[Tensor, "views channels points"]:
    """Bilinear values of maps at image pixels.

    A map of any resolution spans the same area as the image of `size` (width, height); pixels are those of
    the image, centres at integers. Outside, the border is repeated.
    """
    extent = pixels.new_tensor(size)
    unit = (2 * pixels + 1) / extent - 1
    return F.grid_sample(
        maps, unit.unsqueeze(1), mode="bilinear", padding_mode="border", align_corners=False
    ).squeeze(2)
