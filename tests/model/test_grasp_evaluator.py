from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation

from neugrasp.geometry.pose import rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper, bundled
from neugrasp.model.grasp_evaluator import (
    BOX,
    LEVELS,
    FineGrid,
    GraspEvaluator,
    Hand,
    box_points,
    boxes,
    mirrored,
    numbers,
)

WORKSPACE = Workspace()
HAND = Hand.of(Gripper.load("panda"))
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def ball(centre: tuple[float, float, float], radius: float = 0.03) -> torch.Tensor:
    distance = np.linalg.norm(WORKSPACE.voxel_centres() - centre, axis=-1) - radius
    table = WORKSPACE.voxel_centres()[..., 2] - WORKSPACE.table_height
    return torch.from_numpy(np.clip(np.minimum(distance, table) / WORKSPACE.truncation, -1, 1)).float()


def poses(count: int = 30) -> np.ndarray:
    rng = np.random.default_rng(1)
    rotations = Rotation.random(count, random_state=2).as_matrix()
    return np.stack([rigid(r, rng.uniform(0.07, 0.23, 3)) for r in rotations])


def seen(grid: torch.Tensor, at: np.ndarray) -> np.ndarray:
    return boxes(FineGrid.of(grid, WORKSPACE), torch.from_numpy(at).float()).numpy() / LEVELS


def test_a_box_is_the_distance_at_its_places():
    centre = (0.16, 0.14, 0.09)
    at = poses()
    places = np.einsum("kij,pj->kpi", at[:, :3, :3], box_points().numpy()) + at[:, None, :3, 3]
    table = places[..., 2] - WORKSPACE.table_height
    distance = np.minimum(np.linalg.norm(places - centre, axis=-1) - 0.03, table) / WORKSPACE.truncation
    inside = WORKSPACE.contains(places)
    error = np.abs(seen(ball(centre), at).reshape(len(at), -1) - np.clip(distance, -1, 1))
    # Half a fine voxel's diagonal is 2.2 mm, 0.07 of the truncation; corners of the field are rounded off.
    assert error[inside].max() < 0.2
    assert error[inside].mean() < 0.03


def test_outside_of_the_cube_stands_the_table():
    grid = torch.full((40, 40, 40), -1.0)
    at = rigid(translation=(0.5, 0.5, 0.06))[None]
    heights = 0.06 + box_points().numpy()[:, 2] - WORKSPACE.table_height
    assert np.allclose(seen(grid, at).reshape(-1), np.clip(heights / WORKSPACE.truncation, -1, 1), atol=0.06)


def test_moving_scene_and_grasp_together_changes_nothing():
    """A quarter turn of the cube, which the grid carries out exactly."""
    centre = WORKSPACE.size / 2
    about = rigid(translation=(centre, centre, 0)) @ rigid(TURN) @ rigid(translation=(-centre, -centre, 0))
    grid = ball((0.16, 0.11, 0.09))
    turned = torch.rot90(grid, 1, (0, 1))
    at = poses()
    before, after = seen(grid, at), seen(turned, about @ at)
    assert np.abs(before - after).mean() < 0.01
    assert np.quantile(np.abs(before - after), 0.999) < 0.15  # places that round to the other neighbour
    told = [numbers(torch.from_numpy(each).float(), WORKSPACE) for each in (at, about @ at)]
    assert torch.allclose(*told, atol=1e-5)


def test_shifting_by_voxels_changes_nothing():
    step = 3 * WORKSPACE.voxel_size
    grid = ball((0.14, 0.14, 0.09))
    at = poses()
    at[:, :3, 3] = 0.14 + (at[:, :3, 3] - 0.14) * 0.2
    moved = rigid(translation=(step, 0, 0)) @ at
    before, after = seen(grid, at), seen(torch.roll(grid, 3, 0), moved)
    assert np.abs(before - after).mean() < 0.01


@pytest.mark.parametrize(("x", "y"), [(True, False), (False, True), (True, True)])
def test_a_mirror_is_the_mirrored_scene(x: bool, y: bool):
    """A grasp whose axes are the cube's, in its middle: mirroring the grid is mirroring the box."""
    middle = WORKSPACE.size / 2
    at = rigid(np.diag([1.0, -1.0, -1.0]), (middle, middle, 0.09))[None]
    grid = ball((0.17, 0.13, 0.08))
    axes = [axis for axis, flips in ((0, x), (1, y)) if flips]
    told = torch.from_numpy(at).float()
    box, of_up = boxes(FineGrid.of(grid, WORKSPACE), told), numbers(told, WORKSPACE)
    flipped, _ = mirrored(box, of_up, x, y)
    expected = seen(grid.flip(axes), at)
    assert np.abs(flipped.numpy() / LEVELS - expected).mean() < 0.01


def test_a_half_turn_about_the_approach_is_both_mirrors():
    at = poses()
    half = at @ rigid(np.diag([-1.0, -1.0, 1.0]))
    grid = FineGrid.of(ball((0.16, 0.14, 0.09)), WORKSPACE)
    told = torch.from_numpy(at).float()
    box, of_up = mirrored(boxes(grid, told), numbers(told, WORKSPACE), True, True)
    turned = torch.from_numpy(half).float()
    assert (box.float() - boxes(grid, turned).float()).abs().mean() < 0.01 * LEVELS
    assert torch.allclose(of_up, numbers(turned, WORKSPACE), atol=1e-5)


def test_mirror_images_get_one_answer():
    torch.manual_seed(0)
    network = GraspEvaluator((4, 6, 8), 8).eval()
    box = torch.randint(-LEVELS, LEVELS, (5, *BOX), dtype=torch.int8)
    of_up = torch.randn(5, 4)
    for x, y in ((True, False), (False, True), (True, True)):
        assert torch.allclose(
            network.symmetric(box, of_up, HAND),
            network.symmetric(*mirrored(box, of_up, x, y), HAND.mirrored(x, y)),
            atol=1e-5,
        )


def test_no_grasps_are_no_answers():
    none = torch.zeros(0, 4, 4)
    box = boxes(FineGrid.of(ball((0.15, 0.15, 0.08)), WORKSPACE), none)
    assert box.shape == (0, *BOX)
    assert GraspEvaluator().eval()(box, numbers(none, WORKSPACE), HAND).shape == (0,)


@pytest.mark.parametrize("name", bundled())
def test_a_hand_is_where_its_parts_are(name: str):
    """Of each place of the box, whether it lies inside a part, as a linear program would say."""
    gripper = Gripper.load(name)
    places = box_points().numpy()
    mount = np.array([0, gripper.max_opening / 2, gripper.finger_mount])
    fingers = [hull + mount for hull in gripper.finger.hulls]
    parts = [*gripper.palm.hulls, *fingers, *(hull * [-1, -1, 1] for hull in fingers)]
    inside = np.any(
        [Delaunay(part - [0, 0, gripper.tcp_height]).find_simplex(places) >= 0 for part in parts], axis=0
    )
    told = Hand.of(gripper).box.reshape(-1).numpy()
    assert inside.any()
    assert (told[~inside] > -1e-6).all()
    assert (told[inside] < 1e-6).all()


def test_between_open_fingers_nothing_is():
    told = HAND.box[0]
    middle, tip = 11, 11  # y = 0, and z within 1 mm of the TCP
    assert abs(float(box_points().reshape(*BOX, 3)[3, middle, tip, 2])) < 0.005
    assert float(told[3, middle, tip]) == pytest.approx(1, abs=0.35)
    assert float(told[3, middle, 0]) < 0  # the palm, 9 cm behind


def test_a_wider_gripper_of_the_same_shape_is_told_apart():
    gripper = Gripper.load("panda")
    wider = Hand.of(replace(gripper, max_opening=0.1))
    assert not torch.equal(wider.box, HAND.box)
    assert float(wider.numbers[0, 0]) == pytest.approx(0.25)
    assert HAND.numbers.tolist() == [[0, 0, 0]]


def test_one_hand_for_all_is_one_for_each():
    torch.manual_seed(0)
    network = GraspEvaluator((4, 6, 8), 8).eval()
    box = torch.randint(-LEVELS, LEVELS, (5, *BOX), dtype=torch.int8)
    of_up = torch.randn(5, 4)
    each = HAND[torch.zeros(5, dtype=torch.int64)]
    assert torch.allclose(network(box, of_up, HAND), network(box, of_up, each), atol=1e-6)
