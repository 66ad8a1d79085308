"""The good capture, in memory and on disk, and the folder's own modules."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from neugrasp.data.scene_folder import write_scene
from neugrasp.observation import Views

sys.path.insert(0, str(Path(__file__).parent))

from ray_traced import good_capture


@pytest.fixture(scope="session")
def good() -> Views:
    """Four photos of a ball and a box, 240 x 135 pixels."""
    return good_capture(size=(240, 135))


@pytest.fixture
def good_folder(good: Views, tmp_path: Path) -> Path:
    """`good` on disk."""
    write_scene(tmp_path / "good", good)
    return tmp_path / "good"
