"""The word that lets a client in, in a file: a command line can be read by everybody on a machine."""

from __future__ import annotations

import re
from pathlib import Path

from neugrasp.data.user_files import read_text
from neugrasp.errors import InputError

TOKEN = re.compile(r"[A-Za-z0-9._~+/=-]{16,512}")
"""What a header can carry, and nobody guesses."""


def read_token(file: Path | None) -> str | None:
    """The token in a file; none without one. Raises `InputError` where it cannot be used."""
    if file is None:
        return None
    try:
        token = read_text(file).strip()
    except FileNotFoundError:
        raise InputError(f"{file}: missing; --token-file names it") from None
    if not TOKEN.fullmatch(token):
        raise InputError(f"{file}: must hold one token of 16 to 512 letters, digits and . _ ~ + / = -")
    return token
