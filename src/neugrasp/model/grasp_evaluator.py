"""Does this grasp hold? A small network that sees the surface in the grasp's own frame.

Not in the paper. The head answers for every voxel at once, in the frame of the grid, and must learn each pose
anew; here all poses are one, so single trials of physics teach all of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Float, Float32, Int8
from torch import Tensor, nn

from neugrasp.geometry.workspace import Workspace

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
NUMBERS = 4
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


class GraspEvaluator(nn.Module):
    """Boxes to the probability that a grasp holds. Slices across the fingers are channels."""

    def __init__(self, widths: tuple[int, int, int] = (32, 48, 64), hidden: int = 64) -> None:
        super().__init__()
        first, second, third = widths
        self.widths, self.hidden = widths, hidden
        self.see = nn.Sequential(
            nn.Conv2d(BOX[0], first, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(first, second, 3, stride=2, padding=1),
            nn.ReLU(),
            nn.Conv2d(second, third, 3, padding=1),
            nn.ReLU(),
        )
        cells = _half(_half(ALONG)) * _half(_half(DEEP))
        self.weigh = nn.Sequential(
            nn.Linear(third * cells + NUMBERS, hidden), nn.ReLU(), nn.Linear(hidden, hidden), nn.ReLU()
        )
        self.answer = nn.Linear(hidden, 1)

    def forward(self, box: Int8[Tensor, "k 7 23 16"], of_up: Float[Tensor, "k 4"]) -> Float[Tensor, " k"]:
        """Logits of boxes and numbers."""
        seen = self.see((box.float() / LEVELS).contiguous(memory_format=torch.channels_last))
        logits: Tensor = self.answer(self.weigh(torch.cat([seen.flatten(1), of_up], dim=1)))
        return logits.squeeze(1)

    def symmetric(self, box: Int8[Tensor, "k 7 23 16"], of_up: Float[Tensor, "k 4"]) -> Float[Tensor, " k"]:
        """The mean logits of a grasp and its mirror images, which `forward` has only learned."""
        answers = [self(*mirrored(box, of_up, x, y)) for x, y in SIDES]
        return torch.stack(answers).mean(0)


def _half(count: int) -> int:
    return (count + 1) // 2
