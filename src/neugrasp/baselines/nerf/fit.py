"""A radiance field fitted to one scene: photos for its colours, exact depth for its geometry."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
import torch
from torch import Tensor

from neugrasp.baselines.nerf.field import FieldConfig, RadianceField, RayBundle, Seen
from neugrasp.baselines.nerf.histograms import depth_loss, distortion_loss, interlevel_loss
from neugrasp.errors import NeuGraspError
from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace
from neugrasp.observation import Depth, Observation

MARGIN = 0.10
"""Metres that the field's box reaches beyond the cube, sidewards."""
NEAREST = 0.05
"""z-depth in metres before which nothing is."""
CHUNK = 4096
"""Rays rendered at once."""


class Diverged(NeuGraspError):
    """A radiance field that learned nothing of its scene."""


@dataclass(frozen=True, kw_only=True)
class FitConfig:
    """How a field is fitted. Steps and rays come from `benchmarks/nerf_curve.py`."""

    field: FieldConfig = field(default_factory=FieldConfig)
    steps: int = 200
    rays: int = 256
    """In a step."""
    learning_rate: float = 3e-2
    last_rate: float = 0.05
    """The learning rate at the end, as a part of the first; it falls exponentially."""
    interlevel: float = 1.0
    distortion: float = 2e-3
    depth: float = 1.0
    """Weight of DS-NeRF's term, on the field and on the proposals."""
    expected_depth: float = 5.0
    """Weight of the error of the expected depth, in metres."""
    spread: tuple[float, float] = (0.02, 0.004)
    """Width of the bell that DS-NeRF's term asks for, metres, at the start and at the end, in geometric
    steps."""
    max_error: float = 0.03
    """Median error of the rendered depth, metres, beyond which the fit has diverged."""


@dataclass(frozen=True)
class Pixels:
    """Pixels of all photos through the box."""

    rays: RayBundle
    colours: Tensor
    """(p, 3) in [0, 1]."""
    depths: Tensor
    """(p,) z-depth, metres; 0 where not known or outside the box."""

    def __len__(self) -> int:
        return len(self.depths)

    def select(self, index: Tensor) -> Pixels:
        """Some of them."""
        rays = self.rays
        some = RayBundle(rays.origins[index], rays.directions[index], rays.near[index], rays.far[index])
        return Pixels(some, self.colours[index], self.depths[index])


def box_of(workspace: Workspace) -> tuple[Tensor, Tensor]:
    """Origin and size (3,) of the field's box, workspace frame."""
    low = torch.tensor([-MARGIN, -MARGIN, 0.0])
    high = torch.tensor([workspace.size + MARGIN] * 2 + [workspace.size])
    return low, high - low


def rays_of(camera: Camera, workspace: Workspace) -> RayBundle:
    """A ray for every pixel (h * w), in rows; where it misses the box it is empty: far is near."""
    grid = camera.pixel_grid().reshape(-1, 2)
    ahead = camera.unproject(grid, np.ones(len(grid)))
    directions = torch.from_numpy(ahead - camera.centre).float()
    origins = torch.from_numpy(np.broadcast_to(camera.centre, ahead.shape).copy()).float()
    low, size = box_of(workspace)
    slanted = torch.where(directions.abs() < 1e-9, 1e-9, directions)
    one, other = (low - origins) / slanted, (low + size - origins) / slanted
    near = torch.minimum(one, other).amax(-1).clamp(min=NEAREST)
    far = torch.maximum(one, other).amin(-1)
    return RayBundle(origins, directions, near, torch.maximum(far, near))


def pixels_of(seen: Observation) -> Pixels:
    """What the photos and depth images of an observation in the workspace frame say of the box."""
    parts = [_pixels(frame.camera, frame.image, frame.depth, seen.workspace) for frame in seen.frames]
    rays = RayBundle(
        *(torch.cat([getattr(p.rays, name) for p in parts]) for name in RayBundle.__dataclass_fields__)
    )
    return Pixels(rays, torch.cat([p.colours for p in parts]), torch.cat([p.depths for p in parts]))


def _pixels(camera: Camera, image: np.ndarray | None, depth: Depth | None, workspace: Workspace) -> Pixels:
    assert image is not None
    assert depth is not None
    rays = rays_of(camera, workspace)
    known = torch.from_numpy(np.where(np.isfinite(depth), depth, 0).reshape(-1)).float()
    known = torch.where((known > rays.near) & (known < rays.far), known, 0)
    colours = torch.from_numpy(image.reshape(-1, 3).copy()).float() / 255
    every = Pixels(rays, colours, known)
    return every.select(_through_box(camera, rays))


def _through_box(camera: Camera, rays: RayBundle) -> Tensor:
    """Indices of the rays of measured pixels that meet the box."""
    measured = torch.from_numpy(camera.measured_pixels().reshape(-1))
    return torch.nonzero(measured & (rays.far > rays.near)).squeeze(1)


def fitted(
    pixels: Pixels,
    workspace: Workspace,
    config: FitConfig,
    device: torch.device,
    seed: int,
    each_step: Callable[[int, RadianceField], None] | None = None,
) -> RadianceField:
    """The field after all steps; `each_step` is shown it after every one.

    Raises `Diverged` where a loss is no number, or the rendered depth is nowhere near the given one.
    """
    generator = torch.Generator().manual_seed(seed)
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        field = RadianceField(config.field, *box_of(workspace)).to(device)
    optimiser = torch.optim.Adam(field.parameters(), lr=config.learning_rate, eps=1e-15)
    for step in range(config.steps):
        progress = step / config.steps
        for group in optimiser.param_groups:
            group["lr"] = config.learning_rate * config.last_rate**progress
        some = pixels.select(torch.randint(len(pixels), (config.rays,), generator=generator))
        loss = _loss(field, _to(some, device), config, progress, generator)
        if not math.isfinite(loss.item()):
            raise Diverged(f"the radiance field diverged: its loss is {loss.item()} after {step} steps")
        optimiser.zero_grad(set_to_none=True)
        loss.backward()
        optimiser.step()
        if each_step is not None:
            each_step(step, field)
    _check(
        field, _to(pixels.select(torch.randint(len(pixels), (CHUNK,), generator=generator)), device), config
    )
    return field


def _loss(
    field: RadianceField, some: Pixels, config: FitConfig, progress: float, generator: torch.Generator
) -> Tensor:
    anneal = 10 * progress / (9 * progress + 1) if progress < 1 else 1.0
    colours, found = field(some.rays, max(anneal, 0.1), generator)
    *proposals, last = found
    loss = ((colours - some.colours) ** 2).mean()
    loss = loss + config.distortion * distortion_loss(last.parts, last.weights)
    for each in proposals:
        bound = interlevel_loss(last.parts, last.weights, each.parts, each.weights)
        loss = loss + config.interlevel * bound
    known = torch.nonzero(some.depths > 0).squeeze(1)
    if len(known):
        start, end = config.spread
        spread = start * (end / start) ** progress
        bells = [depth_loss(*_at(each, known), some.depths[known], spread) for each in found]
        loss = loss + config.depth * torch.stack(bells).mean()
        expected = (last.weights * last.middles).sum(-1) + (1 - last.opacity) * some.rays.far
        loss = loss + config.expected_depth * (expected - some.depths)[known].abs().mean()
    return loss


def _at(seen: Seen, index: Tensor) -> tuple[Tensor, Tensor]:
    return seen.depths[index], seen.weights[index]


def _to(pixels: Pixels, device: torch.device) -> Pixels:
    rays = RayBundle(*(getattr(pixels.rays, n).to(device) for n in RayBundle.__dataclass_fields__))
    return Pixels(rays, pixels.colours.to(device), pixels.depths.to(device))


def _check(field: RadianceField, some: Pixels, config: FitConfig) -> None:
    error = depth_error(field, some)
    if not error < config.max_error:
        raise Diverged(
            f"the radiance field diverged: its depth misses the given one by {1000 * error:.0f} mm in the "
            f"median, of which {1000 * config.max_error:.0f} are accepted; check the poses of the cameras"
        )


@torch.no_grad()
def depth_error(field: RadianceField, some: Pixels) -> float:
    """Median |rendered - given| z-depth in metres, where one is given; what is not opaque misses by 1 m."""
    known = some.select(torch.nonzero(some.depths > 0).squeeze(1))
    if not len(known):
        return math.nan
    _, found = field(known.rays)
    error = torch.where(found[-1].opacity > 0.5, (found[-1].depth - known.depths).abs(), 1.0)
    return float(error.median())


@torch.no_grad()
def rendered_depth(field: RadianceField, camera: Camera, workspace: Workspace) -> Depth:
    """Expected z-depth (h, w) in metres, 0 where the field is not opaque and beside the photo; camera in the
    workspace frame."""
    device = field.origin.device
    rays = rays_of(camera, workspace)
    depth = torch.zeros(len(rays.near))
    for index in _through_box(camera, rays).split(CHUNK):
        some = RayBundle(*(getattr(rays, n)[index].to(device) for n in RayBundle.__dataclass_fields__))
        last = field(some)[1][-1]
        depth[index] = torch.where(last.opacity > 0.5, last.depth, 0).cpu()
    image: Depth = depth.reshape(camera.height, camera.width).numpy()
    return image
