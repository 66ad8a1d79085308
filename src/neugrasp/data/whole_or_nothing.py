"""A folder that is written whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


@contextmanager
def whole_or_nothing(out: Path) -> Iterator[Path]:
    """A folder to write into whose files all move to `out` at the end, or vanish where something fails.

    Files that `out` holds already stay, unless one of the same name replaces them.
    """
    is_new = not out.exists()
    out.mkdir(parents=True, exist_ok=True)
    part = Path(tempfile.mkdtemp(prefix=".part-", dir=out))
    try:
        yield part
        for file in sorted(part.iterdir()):
            file.replace(out / file.name)
    except BaseException:
        shutil.rmtree(part, ignore_errors=True)
        if is_new and not any(out.iterdir()):
            out.rmdir()
        raise
    part.rmdir()
