"""Which grasps are wanted: the rest is counted by its reason, and nothing is lost."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image as Picture

from neugrasp.detection.contract import Detection
from neugrasp.detection.options import Steering
from neugrasp.detection.steering import steered
from neugrasp.detection.things import things_in
from neugrasp.errors import InputError
from neugrasp.geometry.pose import rigid, rotation_about
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp, Grasps
from neugrasp.gripper import Gripper
from neugrasp.observation import Views

DOWN = np.diag([1.0, -1.0, -1.0])
PLACE = rigid(rotation_about((0, 0, 1), 0.4), (1.0, 2.0, 0.7))
"""Where the workspace stands in the world."""
WORKSPACE = Workspace(world_from_workspace=PLACE)


def grasp(x: float, y: float, above_table: float, tilt_deg: float = 0.0, score: float = 0.9) -> Grasp:
    """A grasp in the world, at a place of the workspace, tilted off the vertical."""
    turned = rotation_about((1, 0, 0), np.deg2rad(tilt_deg)) @ DOWN
    return Grasp(rigid(turned, (x, y, 0.05 + above_table)), 0.04, score).moved(PLACE)


def detection(*grasps: Grasp) -> Detection:
    surface, rejected = np.ones((40, 40, 40), np.float32), {"too_narrow": 2}
    return Detection(Grasps.of(grasps), WORKSPACE, Gripper.load("panda"), surface, rejected, 0.5, 0.85)


HIGH, LOW, TILTED = grasp(0.1, 0.1, 0.1), grasp(0.2, 0.2, 0.01), grasp(0.15, 0.1, 0.1, tilt_deg=50)


@pytest.mark.parametrize(
    ("steering", "kept", "reason"),
    [
        (Steering(min_height=0.05), (HIGH, TILTED), "too_low"),
        (Steering(approach=(0, 0, -2, 30)), (HIGH, LOW), "from_another_side"),
        (Steering(top=1), (HIGH,), "beyond_the_best"),
    ],
)
def test_what_is_not_wanted_is_counted(steering: Steering, kept: tuple[Grasp, ...], reason: str):
    found = steered(detection(HIGH, LOW, TILTED), steering)
    assert found.grasps == Grasps.of(kept)
    assert found.rejected == {"too_narrow": 2, reason: 3 - len(kept)}


def two_things(gap: float = 0.05) -> np.ndarray:
    """Boxes about (0.1, 0.15) and (0.2, 0.15), 6 cm high, with `gap` metres of nothing between them."""
    x, y, z = np.moveaxis(WORKSPACE.voxel_centres(), -1, 0)
    half = (0.1 - gap) / 2
    boxes = [np.maximum.reduce([abs(x - at) - half, abs(y - 0.15) - half, z - 0.11]) for at in (0.1, 0.2)]
    return (np.minimum.reduce([*boxes, z - 0.05]) / WORKSPACE.truncation).clip(-1, 1).astype(np.float32)


def test_one_object_at_a_time_is_that_of_the_best_grasp_left():
    """What touches is one object; a grasp belongs to the nearest."""
    here, there = grasp(0.1, 0.15, 0.06, score=0.95), grasp(0.2, 0.15, 0.06, score=0.9)
    also = grasp(0.11, 0.13, 0.03, score=0.86)
    given = replace(detection(here, there, also), tsdf=two_things())
    found = steered(given, Steering(one_object=True))
    assert found.grasps == Grasps.of([here, also])
    assert found.rejected == {"too_narrow": 2, "on_another_object": 1}
    assert steered(given, Steering(one_object=True, top=1)).grasps == Grasps.of([here])
    x, y, z = there.position
    box = (x - 0.02, y - 0.02, z - 0.02, x + 0.02, y + 0.02, z + 0.02)
    assert steered(given, Steering(one_object=True, region=box)).grasps == Grasps.of([there])
    touching = replace(given, tsdf=two_things(gap=-0.01))
    assert steered(touching, Steering(one_object=True)).grasps == Grasps.of([here, there, also])
    nothing = replace(given, tsdf=np.ones_like(given.tsdf))
    assert steered(nothing, Steering(one_object=True)).grasps == Grasps.of([here, there, also])


def test_the_region_of_a_thing_holds_it_and_no_other():
    things = things_in(two_things(), WORKSPACE)
    assert len(things) == 2
    for thing, at in zip(things, (0.1, 0.2) if things[0].voxels[0, 0] < 0.15 else (0.2, 0.1), strict=True):
        inside, outside = grasp(at, 0.15, 0.05), grasp(0.3 - at, 0.15, 0.05)
        found = steered(detection(inside, outside), Steering(region=thing.region(WORKSPACE)))
        assert found.grasps == Grasps.of([inside])
        assert thing.voxels[:, 2].min() > 0.05
    specks = two_things()
    specks[30:31, 5, 20] = -1
    assert len(things_in(specks, WORKSPACE)) == 2


def test_a_region_is_a_box_of_the_world():
    x, y, z = LOW.position
    box = (x - 0.01, y - 0.01, z - 0.01, x + 0.01, y + 0.01, z + 0.01)
    found = steered(detection(HIGH, LOW, TILTED), Steering(region=box))
    assert found.grasps == Grasps.of([LOW])
    assert found.rejected["outside_the_region"] == 2


@pytest.mark.parametrize("view", [0, 2])
def test_a_mask_is_drawn_in_one_of_the_photos(tmp_path: Path, small_views: Views, view: int):
    """White where the low grasp is seen; a grasp that no photo sees is not wanted either."""
    views = tuple(replace(one, camera=one.camera.moved(PLACE)) for one in small_views.frames)
    moved = Views(views, WORKSPACE)
    camera = views[view].camera
    column, row = camera.project(LOW.position)[0].round().astype(int)
    picture = np.zeros((camera.height, camera.width), np.uint8)
    picture[row - 2 : row + 3, column - 2 : column + 3] = 255
    Picture.fromarray(picture).save(tmp_path / "mask.png")
    behind = replace(LOW, pose=LOW.pose @ rigid(translation=(0, 0, -9.0)))
    steering = Steering(mask=(view, tmp_path / "mask.png"))
    found = steered(detection(HIGH, LOW, behind), steering, moved)
    assert found.grasps == Grasps.of([LOW])
    assert found.rejected["outside_the_mask"] == 2

    for mask, message in (
        ((4, tmp_path / "mask.png"), r"--mask 4 .*mask\.png: there are views 0 to 3"),
        ((-1, tmp_path / "mask.png"), "there are views 0 to 3"),
        ((0, tmp_path / "none.png"), r"none\.png: missing"),
    ):
        with pytest.raises(InputError, match=message):
            steered(detection(LOW), Steering(mask=mask), moved)
    Picture.fromarray(np.zeros((90, 160), np.uint8)).save(tmp_path / "mask.png")
    with pytest.raises(InputError, match="160 x 90 pixels; photo 0 has 64 x 36"):
        steered(detection(LOW), Steering(mask=(0, tmp_path / "mask.png")), moved)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        (np.pad(np.ones((9, 9), np.uint8), 12), "nothing in it is brighter than half"),
        (
            np.dstack([np.full((36, 64, 3), 255, np.uint8), np.eye(36, 64, dtype=np.uint8) * 255]),
            "all of it is",
        ),
        (np.zeros((36, 64), np.uint8), "nothing in it is brighter"),
        (np.tile(np.linspace(0, 255, 64).astype(np.uint8), (36, 1)), "75 % of it are grey, as of a photo"),
    ],
    ids=["0 and 1", "transparent", "black", "a photo"],
)
def test_a_mask_that_says_nothing_is_refused(
    tmp_path: Path, small_views: Views, value: np.ndarray, message: str
):
    padded = np.zeros((36, 64), np.uint8)
    if value.ndim == 2:
        padded[: value.shape[0], : value.shape[1]] = value
    Picture.fromarray(padded if value.ndim == 2 else value).save(tmp_path / "mask.png")
    with pytest.raises(InputError, match=f"--mask 0 .*mask.png: {message}"):
        steered(detection(LOW), Steering(mask=(0, tmp_path / "mask.png")), small_views)


@pytest.mark.parametrize(
    ("region", "message"),
    [
        ((-4, -4, -4, 4, 4, 4), "all of the cube lies in it"),
        ((4, 4, 0, 6, 6, 2), "the cube lies outside of it"),
    ],
)
def test_a_region_that_leaves_all_or_nothing_is_told(region: tuple[float, ...], message: str, caplog):
    steered(detection(HIGH, LOW), Steering(region=region))
    assert f"--region: {message}, which reaches from [" in caplog.text


def test_without_wishes_all_stays_as_it_is():
    given = detection(HIGH, LOW)
    found = steered(given, Steering())
    assert (found.grasps, found.rejected) == (given.grasps, given.rejected)


@pytest.mark.parametrize("degrees", [1.0, 49.9, 50.1, 90.0])
def test_the_cone_ends_at_its_angle(degrees: float):
    down = PLACE[:3, :3] @ (0, 0, -1)
    found = steered(detection(TILTED), Steering(approach=(*down, degrees)))
    assert bool(found.grasps) == (degrees > 50)


@pytest.mark.parametrize(
    ("wishes", "message"),
    [
        ({"region": (0, 0, 0, 1, 1, -1)}, "--region 0 0 0 1 1 -1: give the lower corner"),
        ({"region": (0, 0, float("nan"), 1, 1, 1)}, "--region"),
        (
            {"region": (0, 0, 0, 300, 300, 300)},
            "300 m long, which looks like milli",
        ),
        ({"approach": (0, 0, 0, 30)}, "--approach 0 0 0 30"),
        ({"approach": (0, 0, -1, 0)}, "--approach 0 0 -1 0"),
        ({"approach": (0, 0, float("nan"), 30)}, "--approach"),
        ({"top": 0}, "--top 0"),
        ({"min_height": float("nan")}, "--min-height nan: must be in metres"),
        ({"min_height": 20.0}, "--min-height 20: must be in metres"),
    ],
)
def test_wishes_that_cannot_be(wishes: dict[str, object], message: str):
    with pytest.raises(InputError, match=message):
        Steering(**wishes)
