"""Blender, really run: geometry of its photos, equal backgrounds, and a process that may die."""

from __future__ import annotations

import dataclasses
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw

from neugrasp.data.world import Body, Cell, Material, Scene
from neugrasp.errors import InputError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import Array, apply, from_quaternion
from neugrasp.geometry.view_sets import view_set
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.infrared import infrared_pair, infrared_renderer, infrared_sensor
from neugrasp.simulation.materials import sample_materials
from neugrasp.simulation.objects import ObjectModel
from neugrasp.simulation.renderer import Renderer

pytest.importorskip("bpy")
pytestmark = pytest.mark.blender

SIZE = 96
GREEN = Material(
    "diffuse", "test/green", {"base_color": [0.02, 0.9, 0.02], "roughness": 1.0, "specular": 0.0}
)
RED = [0.6, 0.0, 0.0]
TILTED = (0.268, -0.179, 0.358, 0.876)


class Shelf:
    """Three toys: a ball of 15 mm radius, a pan (a ring with a handle), a file that is not there."""

    def __init__(self, folder: Path):
        self.folder = folder
        handle = trimesh.creation.box(
            (0.06, 0.01, 0.012), trimesh.transformations.translation_matrix((0.06, 0, 0))
        )
        shapes = {
            "ball": trimesh.creation.icosphere(4, 0.015),
            "pan": trimesh.util.concatenate([trimesh.creation.torus(0.03, 0.007), handle]),
        }
        for name, shape in shapes.items():
            shape.export(folder / f"{name}.obj", include_normals=False)

    def model(self, object_set: str, name: str) -> ObjectModel:
        path = self.folder / f"{name}.obj"
        return ObjectModel(name, path, (path,), mass=0.1)


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Shelf:
    return Shelf(tmp_path_factory.mktemp("shelf"))


@pytest.fixture(scope="module")
def renderer() -> Iterator[Renderer]:
    with Renderer(threads=2) as renderer:
        yield renderer


@pytest.fixture(scope="module")
def cell() -> Cell:
    """Cropped cameras with off-centre axes over a red table under the light of a room."""
    drawn = sample_cell(Workspace(), "training", 11, "test", size=SIZE, num_targets=1)
    texture = {**drawn.table["texture"], "pattern": "plain", "colours": [RED, RED, RED]}
    table = {**drawn.table, "texture": texture, "specular": 0.0, "roughness": 1.0}
    return dataclasses.replace(drawn, table=table)


def scene_of(*bodies: Body, material: Material = GREEN) -> Scene:
    return Scene("packed", 0, bodies, (material,) * len(bodies))


def ball(x: float, y: float, z: float) -> Body:
    return Body("toys", "ball", 1.0, (x, y, z), (0.0, 0.0, 0.0, 1.0))


def greenness(photo: np.ndarray) -> Array:
    """Share of each pixel covered by something green, roughly: red tables reflect no green."""
    red, green, _ = np.moveaxis((photo / 255.0) ** 2.2, -1, 0)
    share: Array = np.clip(green - red, 0, None)
    return share


def covered_by_ball(camera: Camera, centre: Array, radius: float, fine: int = 4) -> Array:
    """The share of each pixel that a ball covers, by rays against its equation."""
    steps = (np.arange(fine) + 0.5) / fine - 0.5
    du, dv = np.meshgrid(steps, steps)
    pixels = camera.pixel_grid()[:, :, None] + np.stack([du, dv], -1).reshape(-1, 2)
    rays = camera.unproject(pixels, np.ones(pixels.shape[:-1])) - camera.centre
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    across = np.cross(rays, centre - camera.centre)
    share: Array = (np.linalg.norm(across, axis=-1) < radius).mean(axis=-1)
    return share


def outline(camera: Camera, library: Shelf, body: Body) -> np.ndarray:
    """The silhouette of a body: all of its triangles, projected and filled, at four times the size."""
    mesh = trimesh.load(library.model(body.object_set, body.name).visual_mesh)
    place = from_quaternion(body.quaternion_xyzw, body.position)
    pixels, _ = camera.project(apply(place, mesh.vertices * body.scale))
    picture = Image.new("1", (4 * camera.width, 4 * camera.height))
    draw = ImageDraw.Draw(picture)
    for triangle in (pixels[mesh.faces] + 0.5) * 4 - 0.5:
        draw.polygon([tuple(corner) for corner in triangle], fill=1)
    shares = np.asarray(picture).reshape(camera.height, 4, camera.width, 4).mean(axis=(1, 3))
    return shares > 0.5


@pytest.mark.parametrize("position", [(0.15, 0.15, 0.065), (0.06, 0.21, 0.065), (0.22, 0.1, 0.12)])
def test_a_ball_appears_where_its_camera_says(
    renderer: Renderer, shelf: Shelf, cell: Cell, position: tuple[float, float, float]
):
    views = [0, 3]
    photos = renderer.render(cell, scene_of(ball(*position)), shelf, views)
    for camera, photo in zip((cell.cameras[view] for view in views), photos, strict=True):
        expected = covered_by_ball(camera, np.array(position), 0.015)
        seen = greenness(photo) > 0.5 * np.quantile(greenness(photo), 0.995)
        centroids = [
            (mask[..., None] * camera.pixel_grid()).sum(axis=(0, 1)) / mask.sum()
            for mask in (seen.astype(float), (expected > 0.5).astype(float))
        ]
        np.testing.assert_allclose(centroids[0], centroids[1], atol=0.3)


def test_a_scaled_and_tilted_object_has_the_outline_of_its_mesh(renderer: Renderer, shelf: Shelf, cell: Cell):
    cell = dataclasses.replace(
        cell, cameras=tuple(c.cropped_and_resized((18, 20, 78, 80), 240, 240) for c in cell.cameras)
    )
    body = Body("toys", "pan", 1.3, (0.15, 0.15, 0.12), TILTED)
    for view, photo in zip([0, 2], renderer.render(cell, scene_of(body), shelf, [0, 2]), strict=True):
        expected = outline(cell.cameras[view], shelf, body)
        green = greenness(photo)
        seen = green > 0.12 * np.quantile(green, 0.98)
        assert expected.sum() > 2000
        assert (seen & expected).sum() / (seen | expected).sum() > 0.97


def test_where_nothing_changed_scene_and_background_agree(renderer: Renderer, shelf: Shelf):
    """Under an open sky: there is no sun whose shadows reach far."""
    cell = sample_cell(Workspace(), "training", 4, "test", size=128)
    cell = dataclasses.replace(cell, light={**cell.light, "hdri": "courtyard"})
    cameras = range(len(cell.cameras))
    bodies = (ball(0.12, 0.15, 0.065), Body("toys", "pan", 1.0, (0.2, 0.2, 0.09), TILTED))
    scene = sample_materials(Scene("packed", 0, bodies), "transparent-specular", np.random.default_rng(0))
    photos = zip(
        cell.cameras,
        renderer.render(cell, scene, shelf, cameras),
        renderer.render(cell, None, shelf, cameras),
        strict=True,
    )
    far, changed = 0, 0
    for camera, photo, background in photos:
        difference = np.abs(photo.astype(float) - background).sum(axis=-1) / 255
        near = np.any([covered_by_ball(camera, np.array(b.position), 0.11) > 0 for b in bodies], axis=0)
        far += int((~near).sum())
        changed += int((difference[~near] > 0.05).sum())
        assert difference[near].max() > 0.2
    assert far > 10000
    assert changed / far < 0.01


def test_a_photo_does_not_depend_on_what_was_rendered_before_or_on_threads(shelf: Shelf):
    cells = [sample_cell(Workspace(), "training", seed, "train", size=64) for seed in (1, 2)]
    bodies = (ball(0.12, 0.15, 0.065), Body("toys", "pan", 1.0, (0.2, 0.2, 0.09), TILTED))
    scenes = [
        sample_materials(Scene("packed", seed, bodies), "mixed", np.random.default_rng(seed))
        for seed in (5, 6)
    ]
    jobs = [(cell, scene) for cell in cells for scene in (*scenes, None)]
    with Renderer(threads=2) as renderer:
        forwards = [renderer.render(cell, scene, shelf, [0, 4]) for cell, scene in jobs]
    with Renderer(threads=1) as renderer:
        backwards = [renderer.render(cell, scene, shelf, [4, 0])[::-1] for cell, scene in reversed(jobs)]
    np.testing.assert_array_equal(forwards, backwards[::-1])


def test_neither_does_an_infrared_pair(shelf: Shelf):
    """Without a denoiser; with a lamp and the room's light, whose order in Cycles once came from the past."""
    workspace = Workspace()
    bodies = (ball(0.12, 0.15, 0.065), Body("toys", "pan", 1.0, (0.2, 0.2, 0.09), TILTED))
    jobs = []
    for seed in range(6):
        cell = sample_cell(workspace, "released", seed, "test", size=64, num_targets=0)
        sensor = view_set("released", workspace, np.random.default_rng(seed))[0]
        pair, _ = infrared_pair(cell, infrared_sensor(sensor, 0.2), workspace, 0.055, 8)
        scene = Scene("packed", seed, bodies, ())
        jobs.append((pair, sample_materials(scene, "mixed", np.random.default_rng(seed))))
    with infrared_renderer(1) as renderer:
        forwards = [renderer.render(*job, shelf, [0])[0] for job in jobs]
        backwards = [renderer.render(*job, shelf, [0])[0] for job in reversed(jobs)]
    for one, other in zip(forwards, reversed(backwards), strict=True):
        np.testing.assert_array_equal(one, other)


def test_pixels_outside_the_sensor_repeat_its_edge(renderer: Renderer, shelf: Shelf, cell: Cell):
    whole = cell.cameras[0]
    part = dataclasses.replace(whole, sensed=(20.2, 30.5, 80.5, 70.5))
    cell = dataclasses.replace(cell, cameras=(whole, part))
    photo, cut = renderer.render(cell, scene_of(ball(0.15, 0.15, 0.065)), shelf, [0, 1])
    inside = cut[31:71, 20:81].astype(float)
    assert np.abs(inside - photo[31:71, 20:81]).mean() < 3
    np.testing.assert_array_equal(cut, np.pad(cut[31:71, 20:81], ((31, 25), (20, 15), (0, 0)), mode="edge"))


def test_a_killed_blender_is_started_again(renderer: Renderer, shelf: Shelf, cell: Cell):
    scene = scene_of(ball(0.15, 0.15, 0.065))
    before = renderer.render(cell, scene, shelf, [0])
    assert renderer.process_id is not None
    os.kill(renderer.process_id, signal.SIGKILL)
    np.testing.assert_array_equal(renderer.render(cell, scene, shelf, [0]), before)


def test_a_missing_mesh_is_named_and_blender_lives_on(renderer: Renderer, shelf: Shelf, cell: Cell):
    lost = Body("toys", "lost", 1.0, (0.1, 0.1, 0.1), (0.0, 0.0, 0.0, 1.0))
    renderer.render(cell, scene_of(ball(0.15, 0.15, 0.065)), shelf, [0])
    process = renderer.process_id
    with pytest.raises(InputError, match=r"lost\.obj"):
        renderer.render(cell, scene_of(lost), shelf, [0])
    assert greenness(renderer.render(cell, scene_of(ball(0.15, 0.15, 0.065)), shelf, [0])[0]).max() > 0.05
    assert renderer.process_id == process


@pytest.mark.slow
def test_a_blender_that_hangs_is_replaced(shelf: Shelf, cell: Cell):
    with Renderer(timeout_s=15) as renderer:
        before = renderer.render(cell, None, shelf, [0])
        assert renderer.process_id is not None
        os.kill(renderer.process_id, signal.SIGSTOP)
        np.testing.assert_array_equal(renderer.render(cell, None, shelf, [0]), before)
