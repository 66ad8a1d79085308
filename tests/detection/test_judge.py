import numpy as np
import pytest
import torch
from torch import nn

from neugrasp.detection.judge import Judge, JudgeConfig, apart
from neugrasp.geometry.pose import rigid
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper
from neugrasp.model.grasp_evaluator import BOX, LEVELS, GraspEvaluator, Hand, box_points

WORKSPACE, GRIPPER = Workspace(), Gripper.load("panda")
CENTRE, RADIUS = np.array([0.16, 0.14, 0.09]), 0.025


def grid_of(*centres: np.ndarray) -> np.ndarray:
    places = WORKSPACE.voxel_centres()
    balls = [np.linalg.norm(places - centre, axis=-1) - RADIUS for centre in centres]
    distance = np.minimum.reduce([*balls, places[..., 2] - WORKSPACE.table_height])
    return np.clip(distance / WORKSPACE.truncation, -1, 1).astype(np.float32)


class Deep(GraspEvaluator):
    """Sure of a grasp the deeper inside something its TCP lies."""

    def __init__(self) -> None:
        super().__init__((2, 2, 2), 2)
        self.tcp = int(np.linalg.norm(box_points().numpy(), axis=1).argmin())
        self.unused = nn.Identity()

    def forward(self, box: torch.Tensor, of_up: torch.Tensor, hand: Hand) -> torch.Tensor:
        assert box.shape[1:] == BOX
        return -8 * box.reshape(len(box), -1)[:, self.tcp].float() / LEVELS


def test_the_best_come_first_apart_and_as_wide_as_what_they_hold():
    chosen = Judge(Deep(), GRIPPER).find(grid_of(CENTRE), WORKSPACE)
    scores = [grasp.score for grasp in chosen.grasps]
    assert scores
    assert scores == sorted(scores, reverse=True)
    assert min(scores) >= JudgeConfig.threshold
    assert chosen.margin == JudgeConfig.margin
    assert scores[0] == pytest.approx(chosen.best_rejected)
    assert np.linalg.norm(chosen.grasps[0].position - CENTRE) < 0.008
    assert chosen.grasps[0].width == pytest.approx(2 * RADIUS, abs=0.01)
    places = [grasp.position for grasp in chosen.grasps]
    assert all(np.linalg.norm(a - b) >= 0.02 for i, a in enumerate(places) for b in places[:i])


def test_grasps_are_spread_over_objects():
    other = np.array([0.08, 0.22, 0.08])
    chosen = Judge(Deep(), GRIPPER).find(grid_of(CENTRE, other), WORKSPACE)
    for centre in (CENTRE, other):
        assert min(np.linalg.norm(grasp.position - centre) for grasp in chosen.grasps) < 0.012


@pytest.mark.slow
def test_the_same_grid_gives_the_same_grasps():
    one, again = (Judge(Deep(), GRIPPER).find(grid_of(CENTRE), WORKSPACE) for _ in range(2))
    assert [grasp.pose.tolist() for grasp in one.grasps] == [grasp.pose.tolist() for grasp in again.grasps]


def test_what_the_head_proposes_is_judged_too():
    judge = Judge(Deep(), GRIPPER, JudgeConfig(draws=0, rounds=0))
    peak = rigid(np.diag([1.0, -1.0, -1.0]), CENTRE)[None]
    assert not judge.find(grid_of(CENTRE), WORKSPACE).grasps
    (only,) = judge.find(grid_of(CENTRE), WORKSPACE, peak).grasps
    assert np.array_equal(only.pose, peak[0])


def test_an_empty_table_has_no_grasps():
    places = WORKSPACE.voxel_centres()[..., 2] - WORKSPACE.table_height
    empty = np.clip(places / WORKSPACE.truncation, -1, 1).astype(np.float32)
    chosen = Judge(Deep(), GRIPPER).find(empty, WORKSPACE)
    assert chosen.grasps == ()
    assert chosen.best_rejected == 0


def test_every_candidate_ends_as_a_grasp_or_in_a_count():
    config = JudgeConfig(threshold=1.0, draws=100, rounds=0)
    chosen = Judge(Deep(), GRIPPER, config).find(grid_of(CENTRE), WORKSPACE)
    assert chosen.grasps == ()
    assert sum(chosen.rejected.values()) == 100


def test_apart_keeps_the_best_of_each_place():
    poses = np.stack([rigid(translation=(x, 0, 0)) for x in (0.0, 0.01, 0.031, 0.05)])
    assert apart(poses, np.array([0.5, 0.9, 0.8, 0.0]), 0.02, 9) == [1, 2]
    assert apart(poses, np.array([0.5, 0.9, 0.8, 0.0]), 0.02, 1) == [1]


def test_what_is_thinner_than_a_voxel_has_a_width_and_nothing_has_none():
    """A width of 0 is no grasp: other programs refuse a list that holds one."""
    judge, down = Judge(Deep(), GRIPPER), np.diag([1.0, -1.0, -1.0])
    grid = np.ones((WORKSPACE.resolution,) * 3, np.float32)
    grid[:, 20, :] = -0.1  # A plate across the closing direction, one voxel thick.
    plate, beside = WORKSPACE.position_of((20, 20, 20)), WORKSPACE.position_of((20, 5, 20))
    poses = np.stack([rigid(down, plate), rigid(down, beside)])
    thin, none = judge.widths(grid, WORKSPACE, poses)
    assert 0 < thin < 3 * WORKSPACE.voxel_size
    assert none == 0


def test_a_grasp_of_nothing_is_dropped_and_counted():
    class Sure(Deep):
        def forward(self, box: torch.Tensor, of_up: torch.Tensor, hand: Hand) -> torch.Tensor:
            return torch.full((len(box),), 5.0)

    above = rigid(np.diag([1.0, -1.0, -1.0]), (0.05, 0.25, 0.2))[None]
    chosen = Judge(Sure(), GRIPPER).find(grid_of(CENTRE), WORKSPACE, others=above)
    assert all(grasp.width > 0 for grasp in chosen.grasps)
    assert chosen.rejected["nothing_between_the_fingers"] >= 1
