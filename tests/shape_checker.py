"""Beartype, as the tests check with it the shapes that signatures and fields of the package name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, get_args

from beartype import beartype
from jaxtyping import AbstractArray, install_import_hook

PACKAGES = tuple(
    f"neugrasp.{name}" for name in ("model", "kernels", "geometry", "training", "detection", "metrics")
)
"""Where shapes are checked."""


def install() -> None:
    """Checks whatever is imported from now on of the packages."""
    install_import_hook(PACKAGES, "shape_checker.check")


def check(function: Callable[..., Any]) -> Callable[..., Any]:
    """The function with its shapes checked at every call; other types are mypy's, and tests have doubles."""
    shaped = {name: kind for name, kind in function.__annotations__.items() if has_shape(kind)}
    function.__annotations__ = shaped
    return beartype(function) if shaped else function


def has_shape(kind: Any) -> bool:
    """Whether a type is of arrays of a shape, or has such a part."""
    is_array = isinstance(kind, type) and issubclass(kind, AbstractArray)
    return is_array or any(map(has_shape, get_args(kind)))
