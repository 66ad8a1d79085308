"""A good capture and one with a shifted background, on disk."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from neugrasp.data.scene_folder import write_scene


@pytest.fixture
def bad_and_good(make_record: Callable, tmp_path: Path) -> tuple[Path, Path]:
    views = make_record(size=256).views()
    write_scene(tmp_path / "good", views)
    shifted = replace(views.frames[1], background=np.roll(views.frames[1].background, 4, axis=1))
    write_scene(tmp_path / "bad", replace(views, frames=(views.frames[0], shifted, *views.frames[2:])))
    return tmp_path / "bad", tmp_path / "good"
