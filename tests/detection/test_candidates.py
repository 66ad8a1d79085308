import numpy as np
import pytest

from neugrasp.detection.candidates import Candidates, surface_cloud
from neugrasp.geometry.pose import is_rigid, rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

WORKSPACE = Workspace()
CENTRE, RADIUS = np.array([0.16, 0.14, 0.09]), 0.025


@pytest.fixture(scope="module")
def candidates() -> Candidates:
    return Candidates(Gripper.load("panda"))


def grid_of(centre: np.ndarray = CENTRE) -> np.ndarray:
    places = WORKSPACE.voxel_centres()
    distance = np.minimum(
        np.linalg.norm(places - centre, axis=-1) - RADIUS, places[..., 2] - WORKSPACE.table_height
    )
    return np.clip(distance / WORKSPACE.truncation, -1, 1).astype(np.float32)


def test_the_surface_of_a_ball_is_where_it_is():
    cloud = surface_cloud(grid_of(), WORKSPACE)
    on_ball = cloud.points[:, 2] > 0.075
    outwards = cloud.points[on_ball] - CENTRE
    assert np.abs(np.linalg.norm(outwards, axis=1) - RADIUS).max() < 0.0015
    cosines = np.sum(outwards / RADIUS * cloud.normals[on_ball], axis=1)
    assert cosines.min() > 0.95
    assert {tuple(s) for s in np.sign(outwards[:, :2]).astype(int)} >= {(1, 1), (1, -1), (-1, 1), (-1, -1)}


def test_an_empty_table_has_no_candidates(candidates: Candidates):
    places = WORKSPACE.voxel_centres()[..., 2] - WORKSPACE.table_height
    grid = np.clip(places / WORKSPACE.truncation, -1, 1).astype(np.float32)
    assert candidates.draw(grid, WORKSPACE, np.random.default_rng(0), 50).shape == (0, 4, 4)
    assert candidates.draw(np.ones_like(grid), WORKSPACE, np.random.default_rng(0), 50).shape == (0, 4, 4)


@pytest.mark.parametrize("corner", [(0.0, 0.0, 0.22), (0.3, 0.3, 0.1), (0.15, 0.15, 0.25)])
def test_what_no_camera_need_see_is_no_object(corner: tuple[float, float, float]):
    """A lump in a corner of the cube, or above where objects are expected, as networks imagine them."""
    cloud = surface_cloud(grid_of(np.array(corner)), WORKSPACE)
    assert np.all(cloud.points[:, :2] > 0.02)
    assert np.all(cloud.points[:, :2] < 0.28)
    assert np.all(cloud.points[:, 2] < 0.2)


def test_what_is_drawn_is_a_pose_that_comes_through(candidates: Candidates):
    grid = grid_of()
    poses = candidates.draw(grid, WORKSPACE, np.random.default_rng(0), 200)
    assert len(poses) == 200
    assert all(is_rigid(pose) for pose in poses)
    assert candidates.comes_through(grid, WORKSPACE, poses).all()
    near = candidates.around(poses, np.random.default_rng(1), 2)
    assert near.shape == (400, 4, 4)
    assert all(is_rigid(pose) for pose in near)
    assert np.linalg.norm(near[:, :3, 3] - np.repeat(poses, 2, axis=0)[:, :3, 3], axis=1).max() < 0.05


def test_many_of_them_close_on_the_ball(candidates: Candidates):
    poses = candidates.draw(grid_of(), WORKSPACE, np.random.default_rng(0), 300)
    beside, closing = CENTRE - poses[:, :3, 3], poses[:, :3, 1]
    off = np.linalg.norm(np.cross(beside, closing), axis=1)
    assert np.mean(off < RADIUS) > 0.5


def test_a_hand_in_the_table_or_in_the_ball_does_not_come_through(candidates: Candidates):
    down = np.diag([1.0, -1.0, -1.0])
    over, in_table = rigid(down, CENTRE), rigid(down, (0.16, 0.14, 0.04))
    astride = rigid(down, (0.16, 0.18, 0.09))  # a finger in the middle of the ball
    sideways = rigid([[1, 0, 0], [0, 0, 1], [0, -1, 0]], CENTRE)
    found = candidates.comes_through(grid_of(), WORKSPACE, np.stack([over, in_table, astride, sideways]))
    assert found.tolist() == [True, False, False, False]


def test_the_same_seed_draws_the_same(candidates: Candidates):
    one, other = (candidates.draw(grid_of(), WORKSPACE, np.random.default_rng(seed), 40) for seed in (3, 3))
    assert np.array_equal(one, other)
