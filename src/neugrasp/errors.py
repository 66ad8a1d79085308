"""What can go wrong in a user's hands, each with what would be right."""

from __future__ import annotations

import importlib
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType


class NeuGraspError(Exception):
    """An error that a user can cause and mend. Programs exit with code 2 and print its text."""


class InputError(NeuGraspError, ValueError):
    """A file or a value given by the user cannot be used."""


class SceneError(InputError):
    """A scene folder, a photo in it, or a capture of another program cannot be used."""


class WeightsError(InputError):
    """Weights cannot be used: missing, damaged, newer, or of something else."""


class DataError(InputError):
    """Scenes to learn from, or what was tried in them, cannot be used."""


class ObjectError(InputError):
    """An object or a set of objects for simulation cannot be used."""


class GripperFileError(InputError):
    """A gripper's file cannot be used."""


class WriteError(NeuGraspError):
    """A file cannot be written: the disk is full, the place is read-only, or is none."""


class MissingExtra(NeuGraspError, ImportError):
    """An optional dependency is needed and absent."""

    def __init__(self, module: str, extra: str):
        super().__init__(f"{module!r} is not installed. Run: pip install 'neugrasp[{extra}]'")


class BrokenExtra(NeuGraspError, ImportError):
    """An optional dependency is installed and cannot be loaded, most often for want of a system library."""

    def __init__(self, module: str, error: ImportError):
        super().__init__(
            f"{module!r} is installed but cannot be loaded: {error}. If a lib*.so is missing, install the "
            "system package that holds it (Blender on Debian or Ubuntu: apt install libx11-6 libxi6 "
            "libxfixes3 libxrender1 libxkbcommon0 libsm6 libgl1)"
        )


@contextmanager
def told_as(kind: type[InputError]) -> Iterator[None]:
    """An `InputError` of a block, or of a function decorated with it, becomes one of this kind.

    Who calls can tell it from others, and what reads files need not know for whom it reads.
    """
    try:
        yield
    except InputError as error:
        if isinstance(error, kind):
            raise
        raise kind(*error.args) from error


def require(module: str, extra: str) -> ModuleType:
    """The named module; raises `MissingExtra` with the install command where it is absent, and `BrokenExtra`
    where it is there and does not load."""
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name == module:
            raise MissingExtra(module, extra) from error
        raise BrokenExtra(module, error) from error
    except ImportError as error:
        raise BrokenExtra(module, error) from error
