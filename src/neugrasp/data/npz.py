"""Arrays as bytes: the same arrays give the same bytes, and nothing is ever unpickled."""

from __future__ import annotations

import io
import struct
import tokenize
import warnings
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neugrasp.errors import InputError

LARGEST = 2_000_000_000
"""Bytes that an archive may unpack to."""
WORDS = {"f": "floating numbers", "u": "unsigned integers", "i": "integers", "b": "truth values"}
DAMAGE = (
    ValueError,
    TypeError,
    OSError,
    EOFError,
    RuntimeError,
    MemoryError,
    OverflowError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)
"""What reading a damaged archive, or an array in it, may raise."""


Columns = Mapping[str, tuple[type[np.generic], tuple[int, ...]]]
"""By name the type of a column, and the shape of one entry in it."""


def check_columns(arrays: Mapping[str, NDArray[Any]], columns: Columns, count: int, source: str) -> None:
    """Raises `InputError` naming `source` where a column has another type, or not `count` entries."""
    for name, (kind, shape) in columns.items():
        if arrays[name].shape != (count, *shape) or arrays[name].dtype != kind:
            found = f"{arrays[name].dtype} {arrays[name].shape}"
            raise InputError(f"{source}: {name} is {found}; it must be {np.dtype(kind)} {(count, *shape)}")


def reason_of(error: BaseException) -> str:
    """What an error says, cut where it repeats what it found, which may be long and may be anything."""
    said = f"{error}" or type(error).__name__
    return said if len(said) <= 200 else f"{said[:200]} ..."


def npz_bytes(**arrays: NDArray[Any]) -> bytes:
    """A compressed npz file."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def npz_arrays(
    data: bytes, kinds: Mapping[str, str], source: str, optional: Sequence[str] = ()
) -> dict[str, NDArray[Any]]:
    """The named arrays of an npz file, each of its kind: "f" finite floats, "u" and "i" integers, "b" truth.

    Of the `optional` ones, those that the file has. Raises `InputError` naming `source` where the file is
    damaged, or holds something else.
    """
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(member.file_size for member in archive.infolist()) > LARGEST:
                raise InputError(f"{source}: unpacks to more than {LARGEST / 1e9:.0f} GB")
        with warnings.catch_warnings(), np.load(io.BytesIO(data), allow_pickle=False) as loaded:
            # Numpy's words on a header of Python 2, which a damaged one may look like.
            warnings.simplefilter("ignore", UserWarning)
            found = [name for name in kinds if name not in optional or name in loaded]
            arrays = {name: loaded[name] for name in found}
    except KeyError as error:
        raise InputError(f"{source}: has no array {error}; it must hold {', '.join(kinds)}") from error
    except DAMAGE as error:
        if isinstance(error, InputError):
            raise
        raise InputError(f"{source}: damaged ({reason_of(error)})") from error
    for name, array in arrays.items():
        kind = kinds[name]
        if not isinstance(array, np.ndarray) or array.dtype.kind != kind:
            raise InputError(f"{source}: {name!r} holds no {WORDS[kind]}")
        if kind == "f" and not np.all(np.isfinite(array)):
            raise InputError(f"{source}: {name!r} holds NaN or infinite numbers")
    return arrays
