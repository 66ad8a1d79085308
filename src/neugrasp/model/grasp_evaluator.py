"""Does this grasp hold? A small network that sees the surface in the grasp's own frame.

Not in the paper. The head answers for every voxel at once, in the frame of the grid, and must learn each pose
anew; here all poses are one, so single trials of physics teach all of them. The open hand is seen in the same
frame, so that another gripper is another input and not another network.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32, Int8, Int64
from scipy.spatial import ConvexHull
from torch import Tensor, nn

from neugrasp.geometry.pose import Array
from neugrasp.geometry.workspace import Workspace
from neugrasp.gripper import Gripper

ACROSS = (-0.06, -0.03, -0.012, 0.0, 0.012, 0.03, 0.06)
"""Metres along x, across the fingers: those of the Panda are 2 cm wide, what is held may turn farther out."""
ALONG, STEP = 23, 0.008
"""Values along y, on which the fingers close, and metres between them: from -8.8 to 8.8 cm."""
DEEP, DEEP_STEP, AHEAD = 16, 0.0085, 0.035
"""Values along z, the approach, metres between them, and where they end: from 9.25 cm behind the TCP on."""
BOX = (len(ACROSS), ALONG, DEEP)
FINER = 3
"""A grid is interpolated once to so many voxels for one; the nearest of these is read for each value."""
LEVELS = 127
"""Whole numbers of a distance of one truncation: 0.24 mm each, less than a grid knows."""
NUMBERS, HAND_NUMBERS = 4, 3
NEAR = 0.03
"""Metres from a part of the hand that are one in a `Hand`'s box."""
SIDES = ((False, False), (True, True), (True, False), (False, True))
"""In which mirrors, across x and y, a grasp is the same: `mirrored`."""
CHUNK = 40
"""Grasps read at once: so many stay in a core's cache."""


@dataclass(frozen=True)
class FineGrid:
    """A grid with the table around it, ready to be read at many places."""

    levels: Int8[Tensor, " entries"]
    """`LEVELS` times the signed distance; x slowest."""
    edge: int
    """Entries along an edge."""
    spacing: float
    """Metres between two."""
    origin: float
    """Workspace coordinate of the first, along each axis."""

    @classmethod
    def of(cls, tsdf: Float[Tensor, "r r r"], workspace: Workspace) -> FineGrid:
        """The finer grid of a grid in [-1, 1]. Outside the cube stands the table's plane and nothing else."""
        size, voxel = workspace.resolution, workspace.voxel_size
        heights = (torch.arange(-1, size + 1, device=tsdf.device) + 0.5) * voxel - workspace.table_height
        table = (heights / workspace.truncation).clamp(-1, 1)
        padded = table.expand(size + 2, size + 2, size + 2).clone()
        padded[1:-1, 1:-1, 1:-1] = tsdf.float()
        edge = FINER * (size + 1) + 1
        fine = F.interpolate(padded[None, None], size=(edge,) * 3, mode="trilinear", align_corners=True)
        levels = fine.mul_(LEVELS).round_().to(torch.int8)
        return cls(levels.reshape(-1), edge, voxel / FINER, -voxel / 2)


def box_points(device: torch.device | str = "cpu") -> Float[Tensor, "7*23*16 3"]:
    """Where a box is read, grasp frame, metres."""
    y = (torch.arange(ALONG) - (ALONG - 1) / 2) * STEP
    z = AHEAD - torch.arange(DEEP - 1, -1, -1) * DEEP_STEP
    axes = torch.meshgrid(torch.tensor(ACROSS), y, z, indexing="ij")
    return torch.stack(axes, dim=-1).reshape(-1, 3).to(device)


def boxes(grid: FineGrid, poses: Float[Tensor, "k 4 4"]) -> Int8[Tensor, "k 7 23 16"]:
    """What TCP poses, workspace frame, see of a grid: `LEVELS` for one."""
    points = box_points(poses.device)
    homogeneous = torch.cat([points, torch.ones_like(points[:, :1])], dim=1).T.contiguous()
    scaled = torch.cat([poses[:, :3, :3], poses[:, :3, 3:] - grid.origin], dim=2).float() / grid.spacing
    scaled[:, :, 3] += 0.5
    seen = [_read(grid, part, homogeneous) for part in scaled.split(CHUNK)]
    return torch.cat(seen).reshape(-1, *BOX) if seen else grid.levels.new_zeros(0, *BOX)


def _read(grid: FineGrid, scaled: Tensor, points: Tensor) -> Tensor:
    """The nearest entries (k, p) at points (4, p) placed by (k, 3, 4), in entries and half of one on."""
    places = torch.matmul(scaled.transpose(0, 1), points).clamp_(0, grid.edge - 1)
    x, y, z = places.int()
    return grid.levels[x.mul_(grid.edge).add_(y).mul_(grid.edge).add_(z)]


def numbers(poses: Float[Tensor, "k 4 4"], workspace: Workspace) -> Float32[Tensor, "k 4"]:
    """What a box does not tell of poses.

    How the world's up lies in the grasp frame, and the height of the TCP above the table in units of 10 cm.
    """
    up = poses[:, 2, :3]
    height = (poses[:, 2, 3:4] - workspace.table_height) / 0.1
    return torch.cat([up, height], dim=1).float()


def mirrored(
    box: Int8[Tensor, "k 7 23 16"], of_up: Float[Tensor, "k 4"], x: bool, y: bool
) -> tuple[Int8[Tensor, "k 7 23 16"], Float[Tensor, "k 4"]]:
    """The same grasp seen in a mirror across x, y, or both, which is a half turn about the approach."""
    axes = [axis for axis, flips in ((1, x), (2, y)) if flips]
    signs = of_up.new_tensor([-1.0 if x else 1.0, -1.0 if y else 1.0, 1.0, 1.0])
    return (box.flip(axes) if axes else box), of_up * signs


@dataclass(frozen=True)
class Hand:
    """Open grippers in the frame of a grasp: one for all grasps of a batch, or one for each."""

    box: Float32[Tensor, "h 7 23 16"]
    """Signed distance to the nearest part, in units of `NEAR`, within [-1, 1]; + outside."""
    numbers: Float32[Tensor, "h 3"]
    """What shapes do not tell: how far it opens, how hard it closes, how its pads rub; 0 is the Panda's."""

    @classmethod
    def of(cls, gripper: Gripper) -> Hand:
        """One gripper. Fingers on a linkage stand as far ahead as they come when they close."""
        points = box_points().numpy() + np.array([0, 0, gripper.tcp_height])
        parts = (*gripper.palm.hulls, *gripper.finger_hulls(gripper.max_opening))
        distance = np.min([_outside_of(part, points) for part in parts], axis=0) / NEAR
        numbers = [
            gripper.max_opening / 0.08 - 1,
            np.log(gripper.closing_force / 20),
            gripper.pads.lateral_friction - 1,
        ]
        box = torch.from_numpy(distance.clip(-1, 1)).float().reshape(1, *BOX)
        return cls(box, torch.tensor([numbers]).float())

    @classmethod
    def joined(cls, hands: list[Hand]) -> Hand:
        """All in one; needs at least one."""
        return cls(torch.cat([hand.box for hand in hands]), torch.cat([hand.numbers for hand in hands]))

    def __getitem__(self, chosen: Int64[Tensor, " n"]) -> Hand:
        """Those of the numbers `chosen`, one for each."""
        return Hand(self.box[chosen], self.numbers[chosen])

    def to(self, device: torch.device | str) -> Hand:
        """The same on another device."""
        return Hand(self.box.to(device), self.numbers.to(device))

    def mirrored(self, x: bool, y: bool) -> Hand:
        """As `mirrored`: two fingers need not be each other's mirror image."""
        axes = [axis for axis, flips in ((1, x), (2, y)) if flips]
        return Hand(self.box.flip(axes), self.numbers) if axes else self


def _outside_of(hull: Array, points: Array) -> Array:
    """Metres (n,) by which points (n, 3) lie outside a convex part; inside, negative. Before an edge or a
    corner it is less than the distance."""
    planes = ConvexHull(hull).equations
    return np.asarray((points @ planes[:, :3].T + planes[:, 3]).max(axis=1))


class GraspEvaluator(nn.Module):
    """Boxes to the probability that a grasp holds. Slices across the fingers are channels."""

    def __init__(self, widths: tuple[int, int, int] = (32, 48, 64), hidden: int = 64) -> None:
        super().__init__()
        first, second, third = widths
        self.widths, self.hidden = widths, hidden
        self.see_surface = nn.Conv2d(BOX[0], first, 3, stride=2, padding=1)
        self.see_hand = nn.Conv2d(BOX[0], first, 3, stride=2, padding=1, bias=False)
        self.see = nn.Sequential(
            nn.ReLU(),
            nn.Conv2d(first, second, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(second, third, 3, padding=1),
            nn.ReLU(),
        )
        cells = _half(_half(ALONG)) * _half(_half(DEEP))
        inputs = third * cells + NUMBERS + HAND_NUMBERS
        self.weigh = nn.Sequential(nn.Linear(inputs, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU())
        self.answer = nn.Linear(hidden, 1)

    def forward(
        self, box: Int8[Tensor, "k 7 23 16"], of_up: Float[Tensor, "k 4"], hand: Hand
    ) -> Float[Tensor, " k"]:
        """Logits of boxes and numbers; `hand` is one, or one for each."""
        surface = (box.float() / LEVELS).contiguous(memory_format=torch.channels_last)
        # One hand is looked at once, however many grasps there are.
        seen = self.see(self.see_surface(surface) + self.see_hand(hand.box))
        of_hand = hand.numbers.expand(len(box), HAND_NUMBERS)
        logits: Tensor = self.answer(self.weigh(torch.cat([seen.flatten(1), of_up, of_hand], dim=1)))
        return logits.squeeze(1)

    def symmetric(
        self, box: Int8[Tensor, "k 7 23 16"], of_up: Float[Tensor, "k 4"], hand: Hand
    ) -> Float[Tensor, " k"]:
        """The mean logits of a grasp and its mirror images, which `forward` has only learned."""
        answers = [self(*mirrored(box, of_up, x, y), hand.mirrored(x, y)) for x, y in SIDES]
        return torch.stack(answers).mean(0)


def _half(count: int) -> int:
    return (count + 1) // 2
