"""Reading images and volumes at continuous places, for every view at once: the only `grid_sample` here.

A `LookupTable` holds a row for each pixel or voxel; an `InterpolationIndex` says which rows lie around a
place and how much each counts. Where rows have many channels this is several times as fast as `grid_sample`
on a CPU, and one index serves several tables.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, ParamSpec, TypeVar

import numpy as np
import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int, Int32
from torch import Tensor

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.pose import inverse

AUTOCASTS = ("cpu", "cuda", "mps", "xpu")
"""Kinds of device that autocast knows."""

P = ParamSpec("P")
R = TypeVar("R")


def full_precision(function: Callable[P, R]) -> Callable[P, R]:
    """The function outside of any autocast: geometry in bfloat16 would be off by whole pixels."""

    @functools.wraps(function)
    def exact(*args: P.args, **kwargs: P.kwargs) -> R:
        with ExitStack() as stack:
            for kind in AUTOCASTS:
                if torch.is_autocast_enabled(kind):
                    stack.enter_context(torch.autocast(kind, enabled=False))
            return function(*args, **kwargs)

    return exact


def reduced_type(device: torch.device) -> torch.dtype | None:
    """The type of numbers that autocast takes for products on a device, None where it is off."""
    if device.type in AUTOCASTS and torch.is_autocast_enabled(device.type):
        return torch.get_autocast_dtype(device.type)
    return None


@dataclass(frozen=True)
class LookupTable:
    """Values to be read at places between them."""

    values: Float[Tensor, "rows channels"]
    """In full precision."""
    read_from: Float[Tensor, "rows channels"]
    """The same in the precision of what is read; gradients add up in the values' own."""

    @classmethod
    def of(cls, values: Float[Tensor, "rows channels"]) -> LookupTable:
        """Read in the precision of the products: under autocast, in bfloat16."""
        return cls(values, values.detach().to(reduced_type(values.device) or values.dtype))

    @classmethod
    def of_maps(cls, maps: Float[Tensor, "views channels height width"]) -> LookupTable:
        """A table of maps, row by row of pixels; best where the channels lie last in memory."""
        return cls.of(_pixels_as_rows(maps))

    @classmethod
    def of_images(cls, images: Float[Tensor, "views 3 height width"]) -> LookupTable:
        """A table of images, read exactly."""
        rows = _pixels_as_rows(images)
        return cls(rows, rows.detach())


@dataclass(frozen=True)
class InterpolationIndex:
    """Places between the entries of a table: which rows lie around each, and how much each counts."""

    rows: Int32[Tensor, "*places corners"]
    """From the first row of the table on."""
    shares: Float[Tensor, "*places corners"]
    """In full precision; they sum to one, or are 0 where nothing is to be read."""

    def part(self, places: slice | Int[Tensor, " chosen"]) -> InterpolationIndex:
        """Some of the places, along the last axis of them."""
        return InterpolationIndex(self.rows[..., places, :], self.shares[..., places, :])

    def where(self, known: Bool[Tensor, "*places"]) -> InterpolationIndex:
        """The same places, but 0 is read where `known` is false."""
        return InterpolationIndex(self.rows, self.shares * known.unsqueeze(-1))

    def read(self, table: LookupTable) -> Float[Tensor, "*places channels"]:
        """Values at the places."""
        corners = self.rows.shape[-1]
        places = self.rows.reshape(-1, corners), self.shares.reshape(-1, corners)
        values: Tensor = _Read.apply(table.values, table.read_from, *places)
        return values.reshape(*self.rows.shape[:-1], -1)


def _pixels_as_rows(maps: Tensor) -> Tensor:
    return maps.permute(0, 2, 3, 1).reshape(-1, maps.shape[1])


def _sums_by_row(num_rows: int, rows: Tensor, shares: Tensor, gradient: Tensor) -> Tensor:
    """(num_rows, c): of the gradients (p, c), as much as the shares (p, k) of the rows (p, k) say."""
    if rows.device.type != "cpu":
        # What lies outside of the photos counts nothing but has the same few rows, which would wait in line.
        sums = gradient.new_zeros(num_rows, gradient.shape[1])
        for row, share in zip(rows.unbind(1), shares.unbind(1), strict=True):
            sums.index_add_(0, row, gradient * share.unsqueeze(1))
        return sums
    by_row, order = rows.flatten().sort(stable=True)
    starts = torch.searchsorted(by_row, torch.arange(num_rows, dtype=rows.dtype))
    places = order.div(rows.shape[1], rounding_mode="floor")
    return F.embedding_bag(places, gradient, starts, mode="sum", per_sample_weights=shares.flatten()[order])


class _Read(torch.autograd.Function):
    """Sums of rows of a table; on a CPU the values' gradient is a sum of rows again, sorted by row."""

    @staticmethod
    def forward(ctx: Any, values: Tensor, read_from: Tensor, rows: Tensor, shares: Tensor) -> Tensor:
        ctx.save_for_backward(rows, shares, read_from)
        return F.embedding_bag(rows, read_from, mode="sum", per_sample_weights=shares.to(read_from.dtype))

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, None, None, Tensor | None]:
        rows, shares, read_from = ctx.saved_tensors
        to_values = to_shares = None
        if ctx.needs_input_grad[0]:
            to_values = _sums_by_row(len(read_from), rows, shares, gradient.float())
        if ctx.needs_input_grad[3]:
            to_shares = torch.einsum("pc,pkc->pk", gradient.float(), read_from[rows].float())
        return to_values, None, None, to_shares


@dataclass(frozen=True)
class CameraTensors:
    """Cameras of equally large images as float32 tensors, in the workspace frame."""

    intrinsics: Float[Tensor, "views 3 3"]
    """Pixels."""
    camera_from_workspace: Float[Tensor, "views 4 4"]
    """Rigid transforms, metres."""
    centres: Float[Tensor, "views 3"]
    """Optical centres, metres."""
    bounds: Float[Tensor, "views 4"]
    """Left, top, right, bottom edges of the measured pixels."""
    size: tuple[int, int]
    """Width and height of the images."""

    @classmethod
    def of(cls, cameras: tuple[Camera, ...] | list[Camera]) -> CameraTensors:
        """From cameras already expressed in the workspace frame. Raises `ValueError` on unequal sizes."""
        sizes = {(camera.width, camera.height) for camera in cameras}
        if len(sizes) != 1:
            raise ValueError(f"cameras of one batch must have one image size, got {sorted(sizes)}")

        def stack(arrays: list[np.ndarray]) -> Tensor:
            return torch.from_numpy(np.stack(arrays)).float()

        return cls(
            stack([camera.intrinsics for camera in cameras]),
            stack([inverse(camera.world_from_camera) for camera in cameras]),
            stack([camera.centre for camera in cameras]),
            stack([np.array(camera.bounds) for camera in cameras]),
            sizes.pop(),
        )

    def to(self, device: torch.device | str) -> CameraTensors:
        """The same cameras on another device."""
        return CameraTensors(
            self.intrinsics.to(device),
            self.camera_from_workspace.to(device),
            self.centres.to(device),
            self.bounds.to(device),
            self.size,
        )

    def select(self, views: list[int]) -> CameraTensors:
        """Some of the cameras, in the given order."""
        return CameraTensors(
            self.intrinsics[views],
            self.camera_from_workspace[views],
            self.centres[views],
            self.bounds[views],
            self.size,
        )

    @full_precision
    def project(
        self, points: Float[Tensor, "points 3"]
    ) -> tuple[Float[Tensor, "views points 2"], Bool[Tensor, "views points"]]:
        """Pixels of workspace points, and whether each was seen."""
        rotation, translation = self.camera_from_workspace[:, :3, :3], self.camera_from_workspace[:, :3, 3:]
        projection = self.intrinsics @ rotation
        homogeneous = projection @ points.T + self.intrinsics @ translation
        depth = homogeneous[:, 2]
        pixels = homogeneous[:, :2] / depth.clamp(min=1e-6).unsqueeze(1)
        u, v = pixels[:, 0], pixels[:, 1]
        left, top, right, bottom = (edge.unsqueeze(1) for edge in self.bounds.unbind(1))
        seen = (depth > 1e-3) & (u >= left) & (u < right) & (v >= top) & (v < bottom)
        return pixels.transpose(1, 2), seen

    @full_precision
    def depths(self, points: Float[Tensor, "points 3"]) -> Float[Tensor, "views points"]:
        """z-depths of workspace points, metres."""
        forward = self.camera_from_workspace[:, 2]
        return forward[:, :3] @ points.T + forward[:, 3:]

    def interpolation(self, pixels: Float[Tensor, "views points 2"], shape: torch.Size) -> InterpolationIndex:
        """Where image pixels lie in maps of shape (views, channels, height, width): a place in their table
        for each view and point."""
        height, width = shape[-2:]
        left, right_share = _between((pixels[..., 0] + 0.5) * (width / self.size[0]) - 0.5, width)
        top, lower_share = _between((pixels[..., 1] + 0.5) * (height / self.size[1]) - 0.5, height)
        first = torch.arange(len(pixels), device=left.device, dtype=torch.int32) * (height * width)
        rows = (top * width + left + first.unsqueeze(1)).unsqueeze(-1)
        below, above = lower_share * right_share, (1 - lower_share) * right_share
        shares = torch.stack([1 - lower_share - above, above, lower_share - below, below], dim=-1)
        return InterpolationIndex(rows + rows.new_tensor([0, 1, width, width + 1]), shares)

    @full_precision
    def rays(
        self, view: int, pixels: Float[Tensor, "rays 2"]
    ) -> tuple[Float[Tensor, "rays 3"], Float[Tensor, "rays 3"]]:
        """Origins and unit directions of the rays through pixels of one view."""
        ones = torch.ones_like(pixels[:, :1])
        in_camera = torch.cat([pixels, ones], dim=1) @ torch.linalg.inv(self.intrinsics[view]).T
        directions = in_camera @ self.camera_from_workspace[view, :3, :3]
        directions = directions / directions.norm(dim=1, keepdim=True)
        return self.centres[view].expand_as(directions), directions


def sample_volume(
    volume: Float[Tensor, "channels x y z"], unit: Float[Tensor, "points 3"]
) -> Float[Tensor, "channels points"]:
    """Trilinear values of a volume at points of the [-1, 1] cube.

    Voxel i of r has its centre at (2 i + 1) / r - 1 (see `Workspace.to_unit`); the border is repeated.
    """
    # grid_sample wants the coordinate of the last axis first.
    grid = unit.flip(-1).reshape(1, 1, 1, -1, 3)
    values = F.grid_sample(
        volume.unsqueeze(0), grid, mode="bilinear", padding_mode="border", align_corners=False
    )
    return values.reshape(volume.shape[0], -1)


def volume_interpolation(unit: Float[Tensor, "points 3"], resolution: int) -> InterpolationIndex:
    """The 8 corners around points of the [-1, 1] cube, in a table of its voxels, x slowest."""
    lower, share = _between((unit + 1) * (resolution / 2) - 0.5, resolution)
    x, y, z = lower.unbind(-1)
    rows = ((x * resolution + y) * resolution + z).unsqueeze(-1)
    steps = [(i * resolution + j) * resolution + k for i in (0, 1) for j in (0, 1) for k in (0, 1)]
    (x1, y1, z1), (x0, y0, z0) = share.unbind(-1), (1 - share).unbind(-1)
    xy = [x0 * y0, x0 * y1, x1 * y0, x1 * y1]
    return InterpolationIndex(
        rows + rows.new_tensor(steps), torch.stack([share * z for share in xy for z in (z0, z1)], dim=-1)
    )


def _between(places: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The lower entry (int32) of places along an axis of `size` entries, and the share of the next."""
    places = places.clamp(0, size - 1)
    lower = places.int().clamp_(max=size - 2)
    return lower, places - lower
