"""Cells: cameras that see the cube, splits that never mix, one seed one cell."""

from __future__ import annotations

import json

import numpy as np
import pytest

from neugrasp.data.world import Cell, camera_to_dict
from neugrasp.errors import InputError
from neugrasp.geometry.workspace import Workspace
from neugrasp.simulation.blender_frames import SENSOR_WIDTH, facing, lens_of, pixels_inside, upright
from neugrasp.simulation.cell import HDRIS, LUMINANCE, sample_cell


def as_json(cell: Cell) -> str:
    cameras = [camera_to_dict(camera) for camera in cell.cameras]
    return json.dumps([cell.seed, cell.num_inputs, cameras, cell.light, cell.table])


def test_one_seed_gives_one_cell_and_everything_in_it_is_plain_data():
    texts = [as_json(sample_cell(Workspace(), "training", seed, "train")) for seed in (3, 3, 4)]
    assert texts[0] == texts[1]
    assert texts[0] != texts[2]


def test_train_and_test_share_no_panorama_and_no_stream():
    assert not set(HDRIS["train"]) & set(HDRIS["test"])
    assert set(LUMINANCE) == {*HDRIS["train"], *HDRIS["test"]}
    for seed in range(20):
        train, test = (sample_cell(Workspace(), "released", seed, split) for split in ("train", "test"))
        assert train.light["hdri"] in HDRIS["train"]
        assert test.light["hdri"] in HDRIS["test"]
        assert train.table["texture"]["offset"] != test.table["texture"]["offset"]


@pytest.mark.parametrize(
    ("name", "num_inputs"), [("paper", 4), ("released", 4), ("training", 4), ("ring6", 6)]
)
def test_cameras_are_inputs_then_targets_and_see_the_middle_of_the_table(name: str, num_inputs: int):
    workspace = Workspace()
    cell = sample_cell(workspace, name, 5, "train", size=128, num_targets=3)
    assert cell.num_inputs == num_inputs
    assert len(cell.cameras) == num_inputs + 3
    for camera in cell.cameras:
        pixel, depth = camera.project(workspace.centre)
        left, top, right, bottom = camera.bounds
        assert (camera.width, camera.height) == (128, 128)
        assert depth > 0.3
        assert left < pixel[0] < right
        assert top < pixel[1] < bottom


@pytest.mark.parametrize(("view_set", "split"), [("arc", "train"), ("paper", "validation")])
def test_unknown_names_are_refused_with_the_choices(view_set: str, split: str):
    with pytest.raises(InputError, match="choose one of"):
        sample_cell(Workspace(), view_set, 0, split)


def test_a_lens_projects_as_its_camera_does():
    """Blender's own projection, written out, against the camera's, for skewed aspect and axis."""
    workspace = Workspace()
    camera = (
        sample_cell(workspace, "paper", 1, "train").cameras[0].cropped_and_resized((30, 12, 190, 201), 96, 80)
    )
    lens = lens_of(camera)
    points = workspace.corners()
    pixels, _ = camera.project(points)
    local = (points - lens.world_from_camera[:3, 3]) @ lens.world_from_camera[:3, :3]
    widths = local[:, :2] / -local[:, 2:] * lens.focal / SENSOR_WIDTH - lens.shift
    stretch = lens.pixel_aspect[0] / lens.pixel_aspect[1]
    u = (widths[:, 0] + 0.5) * camera.width - 0.5
    v = camera.height / 2 - widths[:, 1] * camera.width * stretch - 0.5
    np.testing.assert_allclose(np.stack([u, v], axis=1), pixels, atol=1e-6)


def test_only_pixels_that_were_measured_are_rendered():
    assert pixels_inside((-0.5, -0.5, 9.5, 7.5)) == (0, 0, 10, 8)
    assert pixels_inside((0.4, 2.5, 5.6, 7.5)) == (0, 3, 7, 8)


def test_planes_and_lamps_face_what_they_should():
    wall = upright((0.1, 0.2, 0.0), azimuth=0.7, distance=2.0)
    assert np.linalg.norm(wall[:3, 3] - (0.1, 0.2, 0.0)) == pytest.approx(2.0)
    np.testing.assert_allclose(wall[:3, 3] + 2.0 * wall[:3, 2], (0.1, 0.2, 0.0), atol=1e-12)
    lamp = facing((1.0, 2.0, 3.0), (0.1, 0.1, 0.1))
    np.testing.assert_allclose(-lamp[:3, 2], np.array([-0.9, -1.9, -2.9]) / np.linalg.norm([0.9, 1.9, 2.9]))
    for place in (wall, lamp):
        assert np.linalg.det(place[:3, :3]) == pytest.approx(1.0)
