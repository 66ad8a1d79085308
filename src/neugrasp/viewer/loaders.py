"""What lies at a path, as data of a scene: captures, records, predictions, rounds of an evaluation."""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from neugrasp.data.camera_checks import check_rigid
from neugrasp.data.labels import LABELS_FILE, labels_from_bytes
from neugrasp.data.npz import npz_arrays
from neugrasp.data.scene_folder import FILE, read_scene
from neugrasp.data.user_files import read_bytes
from neugrasp.data.world import Scene, scene_from_json
from neugrasp.detection.files import read_grasp_list
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.evaluation.episode import Attempt, Episode, read_episode
from neugrasp.evaluation.results_io import NEEDED, facts_of, library_of, scene_of, workspace_of
from neugrasp.evaluation.rounds import Rounds
from neugrasp.geometry.pose import from_quaternion, inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper, bundled
from neugrasp.observation import Frame, View, Views
from neugrasp.pictures.shading import free_where_unseen
from neugrasp.viewer.command import Viewer
from neugrasp.viewer.object_meshes import COLOURS, Identity, identity, solids_of
from neugrasp.viewer.scene_data import Colour, GraspMarker, Grid, SceneData, Snapshot, Solid, Truth

log = logging.getLogger(__name__)
GRASPS, GRID = "grasps.json", "tsdf.npz"
MOST_TRUE_GRASPS = 60
"""Labels that held are kept for drawing up to this number, evenly spread over the list."""


@dataclass(frozen=True)
class Choices:
    """What the user may say about a path."""

    scene: Path | None = None
    gripper: str | None = None
    objects: Path | None = None


def scene_data_of(folder: Path, choices: Choices) -> SceneData:
    """A capture; of a record or a bundled scene with its ground truth."""
    folder = folder.parent if folder.name == FILE else folder
    views = read_scene(folder)
    gripper = Gripper.load(choices.gripper or "panda")
    return SceneData(
        title=folder.resolve().name,
        workspace=views.workspace,
        gripper=gripper,
        views=in_workspace(views),
        moments=(Snapshot(f"{len(views)} photos, nothing predicted yet"),),
        truth=_truth(folder, views.workspace, gripper, choices.objects),
    )


def prediction_data(folder: Path, choices: Choices) -> SceneData:
    """What `neugrasp predict` wrote, with the photos it was made from where they can be found."""
    found = read_grasp_list(folder / GRASPS)
    grasps = found.grasps
    tsdf, workspace = _read_grid(folder / GRID)
    gripper = _gripper(choices.gripper or found.gripper or "panda", folder / GRASPS)
    capture = _capture(folder, found.scene, replace(choices, gripper=choices.gripper or gripper.name))
    if capture is not None and not _same_place(capture.workspace, workspace):
        raise InputError(
            f"{folder}: its workspace lies elsewhere than that of {capture.title}; give the scene that the "
            "prediction was made from: --scene DIR"
        )
    workspace_from_world = inverse(workspace.world_from_workspace)
    candidates = tuple(
        GraspMarker(grasp.moved(workspace_from_world), number=number)
        for number, grasp in enumerate(grasps, 1)
    )
    best = f", the best with score {grasps[0].score:.2f}" if grasps else ""
    moment = Snapshot(f"{len(grasps)} grasps{best}", tsdf, candidates)
    empty = SceneData(folder.resolve().name, workspace, gripper)
    return replace(capture or empty, gripper=gripper, moments=(moment,))


def in_workspace(views: Views) -> tuple[View, ...]:
    """The views with their cameras in the workspace frame."""
    workspace_from_world = inverse(views.workspace.world_from_workspace)
    return tuple(replace(view, camera=view.camera.moved(workspace_from_world)) for view in views.frames)


def _gripper(name: str, file: Path) -> Gripper:
    if not name.endswith(".json") and name not in bundled():
        raise InputError(f"{file}: made for the gripper {name!r}, which is not bundled; give it as --gripper")
    return Gripper.load(name)


def _capture(folder: Path, named: str | None, choices: Choices) -> SceneData | None:
    """The scene of a prediction: as given, else as it names it, else none."""
    if choices.scene is not None:
        return scene_data_of(choices.scene, choices)
    if (folder / FILE).is_file():
        return scene_data_of(folder, choices)
    if not named:
        log.warning("%s does not say which scene it was made from: no photos; give --scene DIR", folder)
        return None
    try:
        return scene_data_of(Path(named), choices)
    except NeuGraspError as error:
        log.warning("no photos: %s; give the scene as --scene DIR", error)
        return None


def _same_place(a: Workspace, b: Workspace) -> bool:
    return bool(np.allclose(a.world_from_workspace, b.world_from_workspace, atol=1e-6))


def _read_grid(file: Path) -> tuple[Grid, Workspace]:
    if not file.is_file():
        raise InputError(f"{file}: missing; a prediction needs {GRASPS} and {GRID}")
    arrays = npz_arrays(read_bytes(file), {"tsdf": "f", "world_from_workspace": "f"}, str(file))
    pose = check_rigid(arrays["world_from_workspace"].tolist(), f"{file}: world_from_workspace")
    workspace = Workspace(world_from_workspace=pose)
    return checked(arrays["tsdf"], workspace, file), workspace


def checked(grid: np.ndarray, workspace: Workspace, file: Path) -> Grid:
    """A grid of the workspace's resolution with numbers in it. Raises `InputError` naming the file."""
    if grid.shape != (workspace.resolution,) * 3 or not np.all(np.isfinite(grid.astype(np.float32))):
        raise InputError(f"{file}: 'tsdf' must be {workspace.resolution} x 3 finite numbers, is {grid.shape}")
    return grid.astype(np.float32)


def _truth(folder: Path, workspace: Workspace, gripper: Gripper, objects: Path | None) -> Truth:
    """What the generator left beside the photos."""
    grid = folder / "truth.npz"
    tsdf = None
    if grid.is_file():
        stored = npz_arrays(read_bytes(grid), {"tsdf": "f"}, str(grid))["tsdf"]
        tsdf = free_where_unseen(checked(stored, workspace, grid))
    world = folder / "world.json"
    solids: tuple[Solid, ...] = ()
    if world.is_file():
        solids = solids_of(scene_from_json(world.read_text(encoding="utf-8"), world), objects)
    return Truth(tsdf, solids, _true_grasps(folder / LABELS_FILE, gripper))


def _true_grasps(file: Path, gripper: Gripper) -> tuple[GraspMarker, ...]:
    """Grasps that held; labels are given at the grasp point, the TCP lies farther along the approach."""
    if not file.is_file():
        return ()
    labels = labels_from_bytes(read_bytes(file), str(file))
    held = np.flatnonzero(labels.success)
    chosen = held[np.linspace(0, len(held) - 1, min(len(held), MOST_TRUE_GRASPS)).astype(int)]
    grasps = []
    for i in chosen:
        pose = from_quaternion(labels.quaternions[i], labels.points[i])
        grasp = Grasp(pose, float(labels.widths[i])).advanced(gripper.tcp_depth)
        grasps.append(GraspMarker(grasp, True, "held in simulation"))
    return tuple(grasps)


def round_data(evaluation: Path, number: int, choices: Choices) -> SceneData:
    """Round `number` of what `neugrasp evaluate` wrote. Raises `InputError` where it is not there."""
    facts = facts_of(evaluation, NEEDED)
    episode = read_episode(evaluation / "rounds" / f"{number:06d}.json")
    library = library_of(evaluation, choices.objects)
    workspace = workspace_of(facts)
    views = tuple(
        Frame(camera, name=f"camera {i}")  # Photos are not kept with a round.
        for i, camera in enumerate(Rounds.of_facts(facts, library).sensors(number, workspace))
    )
    return SceneData(
        title=f"{evaluation.resolve().name}, round {number}",
        workspace=workspace,
        gripper=Gripper.load(choices.gripper or facts["gripper"]),
        views=views,
        moments=moments_of(episode, choices.objects),
    )


def moments_of(episode: Episode, objects: Path | None) -> tuple[Snapshot, ...]:
    """Every attempt with what lay there before it, then what was left."""
    colours = _colours(episode)
    moments = []
    for attempt in episode.attempts:
        words = f"attempt {attempt.attempt + 1} of {len(episode.attempts)}: {attempt.reason}"
        moments.append(
            Snapshot(words, grasps=(_marker(attempt),), solids=_lying(attempt.before, objects, colours))
        )
    moments.append(Snapshot(f"the end: {episode.ending}", solids=_lying(episode.left, objects, colours)))
    return tuple(moments)


def _colours(episode: Episode) -> dict[Identity, Colour]:
    """One colour for each body, the same at all times."""
    times = [_scene(attempt.before) for attempt in episode.attempts] + [_scene(episode.left)]
    bodies = [identity(body) for scene in times if scene for body in scene.bodies]
    return {body: COLOURS[i % len(COLOURS)] for i, body in enumerate(dict.fromkeys(bodies))}


def _scene(lying: dict[str, Any] | None) -> Scene | None:
    if lying is None or not lying.get("bodies"):
        return None
    return scene_of(lying)


def _lying(
    lying: dict[str, Any] | None, objects: Path | None, colours: dict[Identity, Colour]
) -> tuple[Solid, ...]:
    scene = _scene(lying)
    return solids_of(scene, objects, colours) if scene else ()


def _marker(attempt: Attempt) -> GraspMarker:
    pose = from_quaternion(attempt.quaternion_xyzw, attempt.position)
    note = f"{attempt.reason}; chosen among {attempt.candidates}"
    return GraspMarker(Grasp(pose, attempt.width, attempt.score), attempt.success, note)


def open_scene_data(viewer: Viewer) -> SceneData:
    """Whatever lies at the path. Raises `InputError` where it is nothing that can be shown."""
    path = viewer.path
    choices = Choices(viewer.scene, viewer.gripper, viewer.objects)
    if path.is_file() and path.name == GRASPS:
        path = path.parent
    if (path / GRASPS).is_file():
        return prediction_data(path, choices)
    if path.name == FILE or (path / FILE).is_file():
        return scene_data_of(path, choices)
    if (path / "run.json").is_file() and (path / "rounds").is_dir():
        return round_data(path, viewer.round, choices)
    if path.is_file() and path.parent.name == "rounds" and re.fullmatch(r"\d{6}\.json", path.name):
        return round_data(path.parent.parent, int(path.stem), choices)
    raise InputError(
        f"{path}: nothing to show; give a scene (a folder with {FILE}), a prediction (with {GRASPS}), or "
        "an evaluation (a folder with run.json and rounds/)"
    )
