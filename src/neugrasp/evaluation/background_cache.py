"""Where the photos of empty tables are kept: rendered once, shared by all evaluations of the same rounds."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from pathlib import Path

from neugrasp import simulation
from neugrasp.data.world import Cell, camera_to_dict
from neugrasp.simulation.objects import cache_folder
from neugrasp.simulation.renderer import RenderSettings

PAINTERS = ("blender*.py", "renderer.py", "textures.py")
"""The files of `simulation` that decide how a table looks."""


def background_folder(cell: Cell, settings: RenderSettings, domain: Mapping[str, str]) -> Path:
    """The folder of a cell's backgrounds; another one as soon as the cell, the renderer or the facts of a
    domain are others."""
    described = {
        **domain,
        "cameras": [camera_to_dict(camera) for camera in cell.cameras],
        "seed": cell.seed,
        "light": cell.light,
        "table": cell.table,
        "settings": asdict(settings),
        "renderer": _painters_sha256(),
    }
    key = hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()
    return cache_folder().parent / "cells" / key[:24]


@lru_cache(maxsize=1)
def _painters_sha256() -> str:
    folder = Path(str(simulation.__file__)).parent
    files = sorted(path for pattern in PAINTERS for path in folder.glob(pattern))
    return hashlib.sha256(b"".join(path.read_bytes() for path in files)).hexdigest()
