"""What others add to training: by name, as entry points, or as module:NAME."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from importlib.metadata import entry_points

from neugrasp.errors import InputError


def extension(group: str, name: str, what: str, own: Iterable[str]) -> object:
    """What is declared under `name` in a group of entry points, or lies at module:NAME.

    Raises `InputError`, which calls it `what` and lists the names, `own` ones first, where there is none.
    """
    installed = {point.name: point for point in entry_points(group=group)}
    if name not in installed and ":" not in name:
        known = ", ".join([*own, *sorted(installed)])
        raise InputError(f"unknown {what} {name!r}; choose one of {known}, or name yours as module:NAME")
    try:
        if name in installed:
            return installed[name].load()
        module, _, attribute = name.partition(":")
        return getattr(importlib.import_module(module), attribute)
    except (ImportError, AttributeError, ValueError) as error:
        raise InputError(f"{what} {name!r}: cannot be imported ({error})") from error
