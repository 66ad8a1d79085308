"""Antipodal grasps: geometry that can be checked against bodies of known shape."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from neugrasp.baselines.antipodal import FRICTION_ANGLE, STEEPEST, antipodal_grasp
from neugrasp.data.world import Body, Scene
from neugrasp.geometry.pose import Array, is_rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.grasp import Grasp
from neugrasp.gripper import Gripper
from neugrasp.simulation.grasp_execution import execute
from neugrasp.simulation.gt_tsdf import scan
from neugrasp.simulation.objects import FolderSet, ObjectLibrary
from neugrasp.simulation.physics import World

WORKSPACE = Workspace()
PANDA = Gripper.load("panda")
SEEDS = range(25)
Distance = Callable[[Array], Array]


def box(size: tuple[float, float, float], centre: tuple[float, float, float]) -> Distance:
    """Distance in metres to an upright box."""

    def distance(points: Array) -> Array:
        beyond = np.abs(points - centre) - np.array(size) / 2
        outside = np.linalg.norm(np.maximum(beyond, 0), axis=-1)
        return outside + np.minimum(beyond.max(axis=-1), 0)

    return distance


def ball(radius: float, centre: tuple[float, float, float]) -> Distance:
    def distance(points: Array) -> Array:
        return np.linalg.norm(points - centre, axis=-1) - radius

    return distance


def nothing(points: Array) -> Array:
    return np.ones(points.shape[:-1])


def normal(distance: Distance, point: Array) -> Array:
    steps = 1e-4 * np.eye(3)
    gradient = distance(point + steps) - distance(point - steps)
    return gradient / np.linalg.norm(gradient)


def grid(distance: Distance) -> np.ndarray:
    """The body on the table, as a TSDF."""
    points = WORKSPACE.voxel_centres()
    nearest = np.minimum(distance(points), points[..., 2] - WORKSPACE.table_height)
    return (nearest / WORKSPACE.truncation).clip(-1, 1).astype(np.float32)


def grasps_on(distance: Distance) -> Iterator[Grasp]:
    tsdf = grid(distance)
    for seed in SEEDS:
        grasp = antipodal_grasp(tsdf, WORKSPACE, PANDA, np.random.default_rng(seed))
        assert grasp is not None
        yield grasp


BODIES = [
    pytest.param(box((0.04, 0.09, 0.08), (0.15, 0.13, 0.09)), 0.04, id="box"),
    pytest.param(box((0.05, 0.05, 0.1), (0.2, 0.16, 0.1)), 0.05, id="post"),
    pytest.param(ball(0.03, (0.12, 0.17, 0.08)), 0.06, id="ball"),
]


@pytest.mark.parametrize(("distance", "width"), BODIES)
def test_the_pads_meet_the_body_on_opposite_sides(distance: Distance, width: float) -> None:
    for grasp in grasps_on(distance):
        y = grasp.pose[:3, 1]
        for side in (1, -1):
            contact = grasp.position + side * grasp.width / 2 * y
            assert abs(distance(contact)) < WORKSPACE.voxel_size / 2
            # A gradient over voxels rounds edges off; on the faces it is within the cone.
            angle = np.arccos(np.clip(side * y @ normal(distance, contact), -1, 1))
            assert angle < FRICTION_ANGLE + np.deg2rad(5)
        assert distance(grasp.position) < -WORKSPACE.voxel_size / 2
        assert grasp.width == pytest.approx(width, abs=WORKSPACE.voxel_size)


@pytest.mark.parametrize(("distance", "width"), BODIES)
def test_the_hand_comes_from_above_and_ends_above_the_table(distance: Distance, width: float) -> None:
    tip = PANDA.tip_height - PANDA.tcp_height
    for grasp in grasps_on(distance):
        assert is_rigid(grasp.pose, tolerance=1e-9)
        assert -grasp.approach[2] >= np.cos(STEEPEST) - 1e-9
        assert grasp.advanced(tip).position[2] > WORKSPACE.table_height


def test_one_generator_one_grasp() -> None:
    tsdf = grid(BODIES[0].values[0])
    draws = [antipodal_grasp(tsdf, WORKSPACE, PANDA, np.random.default_rng(seed)) for seed in (3, 3, 4)]
    first, same, other = (grasp.pose for grasp in draws if grasp is not None)
    assert np.array_equal(first, same)
    assert not np.allclose(first, other)


@pytest.mark.slow
@pytest.mark.parametrize(
    "distance",
    [
        pytest.param(nothing, id="empty table"),
        pytest.param(box((0.1, 0.1, 0.08), (0.15, 0.15, 0.09)), id="too wide"),
        pytest.param(ball(0.06, (0.15, 0.15, 0.11)), id="too thick"),
    ],
)
def test_where_there_is_nothing_to_hold_there_is_no_grasp(distance: Distance) -> None:
    tsdf = grid(distance)
    for seed in range(5):
        assert antipodal_grasp(tsdf, WORKSPACE, PANDA, np.random.default_rng(seed)) is None


@pytest.mark.parametrize("value", [-1.0, 1.0])
def test_a_grid_without_a_surface_has_no_grasp(value: float) -> None:
    tsdf = np.full((40, 40, 40), value, dtype=np.float32)
    assert antipodal_grasp(tsdf, WORKSPACE, PANDA, np.random.default_rng(0)) is None


URDF = """<robot name="block"><link name="block"><inertial><mass value="0.1"/></inertial>
<visual><geometry><mesh filename="block.obj"/></geometry></visual>
<collision><geometry><mesh filename="block.obj"/></geometry></collision></link></robot>"""


@pytest.fixture(scope="module")
def block_world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """A world whose one object is a block of 4 x 4 x 8 cm."""
    import trimesh

    folder = tmp_path_factory.mktemp("objects")
    trimesh.creation.box((0.04, 0.04, 0.08)).export(folder / "block.obj", include_normals=False)
    Path(folder, "block.urdf").write_text(URDF)
    with World(WORKSPACE, ObjectLibrary((FolderSet(folder),)), PANDA) as world:
        yield world


@pytest.mark.slow
def test_nearly_all_of_them_hold_a_block(block_world: World) -> None:
    turned = (0.0, 0.0, float(np.sin(0.4)), float(np.cos(0.4)))
    block_world.reset(Scene("single", 0, (Body("folder", "block", 1.0, (0.15, 0.14, 0.091), turned),)))
    block_world.settle()
    scene = Scene("single", 0, block_world.bodies())
    truth = scan(block_world, WORKSPACE)
    reasons = []
    for seed in range(20):
        grasp = antipodal_grasp(truth.values, WORKSPACE, PANDA, np.random.default_rng(seed))
        assert grasp is not None
        block_world.reset(scene)
        reasons.append(execute(block_world, grasp, allow_contact=True).reason)
    assert reasons.count("success") >= 17, reasons
