"""Scenes of a real cell to learn from: an ordinary scene folder, and beside it the grasps that were tried.

`grasps.npz` is that of a record of the simulator (docs/data_format.md); neither depth nor truth is needed.
`targets/`, a second scene folder, may hold photos that are only compared with.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from neugrasp.data.grasp_scene import GraspScene
from neugrasp.data.label_checks import check_labels
from neugrasp.data.labels import LABELS_FILE, GraspLabels, labels_from_bytes, labels_to_bytes
from neugrasp.data.scene_folder import FILE, read_scene, write_scene
from neugrasp.data.user_files import read_bytes
from neugrasp.errors import DataError, InputError, told_as
from neugrasp.observation import Views
from neugrasp.output import whole_file

FEWEST_VIEWS = 2
"""One to see, and one to compare with."""


def is_capture(folder: Path) -> bool:
    """Whether a folder holds a scene of a real cell to learn from, rather than a record of the simulator."""
    return (folder / FILE).is_file() and not (folder / "truth.npz").is_file()


@told_as(DataError)
def read_capture(folder: Path, targets: bool = True) -> GraspScene:
    """The scene in `folder`, without its `targets/` where they are not wanted.

    Raises `DataError` naming the file that is damaged, or what does not fit.
    """
    folder = Path(folder)
    scene = read_scene(folder)
    views = scene.in_workspace_frame()
    labels = folder / LABELS_FILE
    try:
        data = read_bytes(labels)
    except FileNotFoundError:
        raise InputError(f"{labels}: missing; it holds the grasps tried") from None
    compared = _targets(folder / "targets", views) if targets else None
    if targets and compared is None and len(views) < FEWEST_VIEWS:
        raise InputError(
            f"{folder}: has 1 view; to learn from photos alone takes {FEWEST_VIEWS}: one is compared with "
            "what the others say (8 in two groups of 4 is what the paper has)"
        )
    return GraspScene(
        name=folder.name,
        workspace=views.workspace,
        labels=check_labels(labels_from_bytes(data, str(labels)), scene.workspace, str(labels)),
        views=views,
        targets=compared,
    )


def write_labels(folder: Path, labels: GraspLabels) -> None:
    """Writes the grasps tried in the scene of `folder`, whole or not at all, over those of before."""
    with whole_file(Path(folder) / LABELS_FILE) as part:
        part.write_bytes(labels_to_bytes(labels))


def write_capture(folder: Path, views: Views, labels: GraspLabels) -> None:
    """Writes a scene to learn from. `grasps.npz` comes last: a folder without it is not learned from yet."""
    write_scene(folder, views)
    write_labels(folder, labels)


def _targets(folder: Path, views: Views) -> Views | None:
    if not folder.is_dir():
        return None
    targets = read_scene(folder)
    if not np.allclose(targets.workspace.cube, views.workspace.cube):
        raise InputError(f"{folder}: is about another cube than the photos that it belongs to")
    return targets.in_workspace_frame()
