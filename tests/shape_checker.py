"""Beartype, as the tests check with it the shapes that signatures and fields of the package name."""

from __future__ import annotations

from typing import Optional

from beartype import BeartypeConf, FrozenDict, beartype
from jaxtyping import install_import_hook
from numpy.typing import ArrayLike

PACKAGES = tuple(
    f"neugrasp.{name}" for name in ("model", "kernels", "geometry", "training", "detection", "metrics")
)
"""Where shapes are checked."""

# An int may stand for a float. NumPy's `ArrayLike` is a union of protocols that refuses plain tuples; what it
# lets in is checked by what comes out.
check = beartype(
    conf=BeartypeConf(
        is_pep484_tower=True,
        hint_overrides=FrozenDict({ArrayLike: object, Optional[ArrayLike]: object}),  # noqa: UP045
    )
)


def install() -> None:
    """Checks whatever is imported from now on of the packages."""
    install_import_hook(PACKAGES, "shape_checker.check")
