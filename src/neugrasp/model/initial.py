"""Initial values of parameters."""

from __future__ import annotations

from collections.abc import Callable

from jaxtyping import Float
from torch import Tensor


def fill(parameter: Float[Tensor, "*shape"], draw: Callable[[Tensor], Tensor]) -> None:
    """Draws the values of a parameter, but not where only its shape is asked for (PyTorch's meta device).

    Nothing would come of it there, and PyTorch would load its compiler, which takes two seconds.
    """
    if not parameter.is_meta:
        draw(parameter)
