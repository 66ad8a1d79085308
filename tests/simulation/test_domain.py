"""Domains: what is different there, by how much, and that nothing else is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from neugrasp.data.world import Body, Cell, Scene
from neugrasp.errors import InputError
from neugrasp.evaluation.rounds import Rounds
from neugrasp.geometry.pose import inverse
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.cell import sample_cell
from neugrasp.simulation.domain import Domain, DomainLens, Sensor
from neugrasp.simulation.domain_renderer import DomainRenderer, bent, sensed
from neugrasp.simulation.lab import DOMAINS, LAB, domain_of
from neugrasp.simulation.objects import ObjectLibrary
from neugrasp.simulation.physics import World

BODY = Body("glassware", "tumbler", 1.0, (0.15, 0.15, 0.1), (0.0, 0.0, 0.0, 1.0))


class Noise:
    """Takes the place of the renderer, and keeps the cells that it was shown."""

    def __init__(self) -> None:
        self.cells: list[Cell] = []

    def render(
        self, cell: Cell, scene: Scene | None, library: ObjectLibrary, camera_indices: Sequence[int]
    ) -> list[np.ndarray]:
        self.cells.append(cell)
        cameras = [(index, cell.cameras[index]) for index in camera_indices]
        return [
            np.random.default_rng([cell.seed, i]).integers(0, 256, (c.height, c.width, 3), dtype=np.uint8)
            for i, c in cameras
        ]


def cell_of(domain: Domain, workspace: Workspace) -> Cell:
    sensors = Rounds("pile", 0, ObjectLibrary.open(("glassware",)), "mixed", "groups8").sensors(0, workspace)
    drawn = sample_cell(workspace, "groups8", 3, "test", num_targets=0)
    return domain.cell(drawn, sensors, workspace)


def asked(domain: Domain, cell: Cell, scene: Scene | None) -> tuple[Cell, list[np.ndarray]]:
    renders = Noise()
    library = ObjectLibrary.open(("glassware",))
    photos = DomainRenderer(domain, renders).render(cell, scene, library, range(len(cell.cameras)))
    return renders.cells[0], photos


@pytest.mark.slow
def test_poses_are_wrong_by_what_the_lab_says_and_the_same_for_every_scene(workspace: Workspace):
    cell = cell_of(LAB, workspace)
    first, _ = asked(LAB, cell, Scene("pile", 1, (BODY,)))
    second, _ = asked(LAB, cell, None)
    assert LAB.hand_eye is not None
    error = LAB.hand_eye
    for believed, true, again in zip(cell.cameras, first.cameras, second.cameras, strict=True):
        np.testing.assert_array_equal(true.world_from_camera, again.world_from_camera)
        np.testing.assert_array_equal(true.intrinsics, believed.intrinsics)
        off = inverse(believed.world_from_camera) @ true.world_from_camera
        turn = np.rad2deg(np.arccos((np.trace(off[:3, :3]) - 1) / 2))
        assert abs(1000 * np.linalg.norm(off[:3, 3]) - error.millimetres) <= error.view_millimetres + 1e-6
        assert abs(turn - error.degrees) <= error.view_degrees + 1e-6
    offs = [
        inverse(b.world_from_camera) @ t.world_from_camera
        for b, t in zip(cell.cameras, first.cameras, strict=True)
    ]
    assert len({off.tobytes() for off in offs}) == len(offs)


@pytest.mark.slow
def test_the_empty_table_was_lit_otherwise_and_what_the_scenes_see_is_fixed(workspace: Workspace):
    cell = cell_of(LAB, workspace)
    now, _ = asked(LAB, cell, Scene("pile", 1, (BODY,)))
    earlier, _ = asked(LAB, cell, None)
    assert LAB.room is not None
    assert now.light == LAB.room.light
    assert now.table == earlier.table == LAB.room.table
    assert earlier.light["strength"] < now.light["strength"]
    assert earlier.light["rotation"] != now.light["rotation"]


def test_training_is_as_it_was_drawn(workspace: Workspace):
    training = domain_of("training")
    cell = cell_of(training, workspace)
    seen, photos = asked(training, cell, None)
    assert seen == cell
    expected = Noise().render(cell, None, ObjectLibrary.open(("glassware",)), range(8))
    np.testing.assert_array_equal(photos, expected)
    assert training.facts() == {}


def test_photos_of_the_lab_are_whole_and_the_workspace_lies_in_what_is_rendered(workspace: Workspace):
    for camera in cell_of(LAB, workspace).cameras:
        assert (camera.width, camera.height) == (640, 360)
        whole = replace(camera, sensed=None)
        left, top, right, bottom = camera.bounds
        box = workspace.photo_box(whole)
        assert left <= max(box[0], -0.5)
        assert top <= max(box[1], -0.5)
        assert right >= min(box[2], 639.5)
        assert bottom >= min(box[3], 359.5)


@pytest.mark.slow
def test_the_same_scene_has_the_same_noise_and_another_scene_another(workspace: Workspace):
    cell = cell_of(LAB, workspace)
    taking = DomainRenderer(LAB, Noise())
    library = ObjectLibrary.open(("glassware",))
    one, other = (Scene("pile", 1, (replace(BODY, scale=scale),)) for scale in (1.0, 0.9))
    first, again, second = (taking.render(cell, scene, library, [0])[0] for scene in (one, one, other))
    np.testing.assert_array_equal(first, again)
    assert np.any(first != second)


def test_a_lens_shows_a_straight_ray_where_its_model_says(workspace: Workspace):
    lens = DomainLens((455.7, 454.8), (321.5, 190.3), (640, 360), (0.05, -0.02), (0.002, -0.001))
    camera = lens.seen_by(cell_of(domain_of("training"), workspace).cameras[0], workspace)
    column, row = 500, 290
    x, y = (column - 321.5) / 455.7, (row - 190.3) / 454.8
    r2 = x * x + y * y
    factor = 1 + 0.05 * r2 - 0.02 * r2 * r2
    bent_x = x * factor + 2 * 0.002 * x * y - 0.001 * (r2 + 2 * x * x)
    bent_y = y * factor + 0.002 * (r2 + 2 * y * y) - 2 * 0.001 * x * y
    photo = np.zeros((360, 640, 3), np.uint8)
    photo[row - 1 : row + 2, column - 1 : column + 2] = 200
    seen = bent(photo, camera, lens)[..., 0].astype(float)
    v, u = np.mgrid[:360, :640]
    found = np.array([(u * seen).sum(), (v * seen).sum()]) / seen.sum()
    np.testing.assert_allclose(found, (455.7 * bent_x + 321.5, 454.8 * bent_y + 190.3), atol=0.1)
    assert np.hypot(*(found - (column, row))) > 1


def test_a_sensor_darkens_the_corners_and_its_noise_is_as_strong_as_it_says():
    photo = np.full((360, 640, 3), 188, np.uint8)
    seen = sensed(photo, Sensor(0.3, 0.0, 0.0, 95), np.random.default_rng(0)).astype(float)
    light = lambda code: ((code / 255 + 0.055) / 1.055) ** 2.4  # noqa: E731
    assert light(seen[2:6, 2:6].mean()) / light(seen[178:182, 318:322].mean()) == pytest.approx(0.7, abs=0.02)
    noisy = sensed(photo, Sensor(0.0, 0.001, 0.0, 95), np.random.default_rng(0)).astype(float)
    assert light(noisy).std() == pytest.approx(np.sqrt(0.001 * light(188.0)), rel=0.35)


def test_a_part_alone_is_one_change_and_unknown_names_are_told():
    only = domain_of("lab:friction+lens")
    assert (only.friction, only.lens, only.room, only.gripper) == (LAB.friction, LAB.lens, None, None)
    assert only.facts()["domain_sha256"] != LAB.facts()["domain_sha256"]
    with pytest.raises(InputError, match="no part 'lenses'; choose from room"):
        domain_of("lab:lenses")
    with pytest.raises(InputError, match="choose one of training, lab"):
        domain_of("kitchen")


def test_the_lab_is_like_nothing_that_training_draws(workspace: Workspace):
    assert LAB.room is not None
    drawn = [sample_cell(workspace, "training", seed, "train", num_targets=0) for seed in range(60)]
    assert LAB.room.light["hdri"] not in {cell.light["hdri"] for cell in drawn}
    assert LAB.room.table["texture"]["pattern"] not in {cell.table["texture"]["pattern"] for cell in drawn}
    assert LAB.room.table["roughness"] < min(cell.table["roughness"] for cell in drawn)


def test_a_round_of_the_lab_is_drawn_as_that_of_training(workspace: Workspace):
    library = ObjectLibrary.open(("glassware",))
    with World(workspace, library) as world:
        rounds = [
            Rounds("packed", 4, library, "mixed", "released", domain=domain).make(1, world)
            for domain in DOMAINS.values()
        ]
    one, other = rounds
    assert one.scene == other.scene
    assert [c.world_from_camera.tolist() for c in one.cell.cameras] == [
        c.world_from_camera.tolist() for c in other.cell.cameras
    ]
