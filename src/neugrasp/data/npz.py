"""Arrays as bytes: the same arrays give the same bytes, and nothing is ever unpickled."""

from __future__ import annotations

import io
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError


def npz_bytes(**arrays: NDArray[Any]) -> bytes:
    """A compressed npz file."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def npz_arrays(
    data: bytes, names: tuple[str, ...], source: str, optional: tuple[str, ...] = ()
) -> dict[str, NDArray[Any]]:
    """The named arrays of an npz file, and of the `optional` ones those that it has. Raises `InputError`
    naming `source` where it is damaged."""
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as loaded:
            found = [name for name in optional if name in loaded]
            return {name: loaded[name] for name in (*names, *found)}
    except KeyError as error:
        raise InputError(f"{source}: has no array {error}; it must hold {', '.join(names)}") from error
    except (ValueError, OSError, EOFError, zipfile.BadZipFile, zlib.error, NotImplementedError) as error:
        raise InputError(f"{source}: damaged ({error}); generate the record again") from error
