"""Features and volumes -> signed distance and colour at any point."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from neugrasp.geometry.sampling import CameraTensors, Corners, Table, volume_corners
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.attention import RayTransformer, ViewTransformer
from neugrasp.model.chunks import in_chunks
from neugrasp.model.config import ModelConfig
from neugrasp.model.view_layer import fused

ORDER_DIM = 8
POSITION_FREQUENCIES = (1.0, 2.0, 4.0)


@dataclass(frozen=True)
class EncodedViews:
    """A scene as the field reads it."""

    images: Tensor
    """(n, 3, s, s) RGB, for the colours."""
    maps: tuple[Tensor, ...]
    """Scene features (n, c, h, w), then foreground features where the model has them."""
    volumes: Tensor
    """(r, r, r, k c): the shape prior at the voxels, then the occupancy prior where the model has one."""
    cameras: CameraTensors
    workspace: Workspace


@dataclass(frozen=True)
class Places:
    """Points along rays, and what the scene shows there."""

    points: Tensor
    """(r, s, 3) workspace metres."""
    tokens: tuple[Tensor, ...]
    """Of the views (n, r s, d), for each branch."""
    seen: Tensor
    """(n, r s) bool."""

    @property
    def num_seen(self) -> Tensor:
        """(r, s) how many views see each point."""
        return self.seen.sum(0).reshape(self.points.shape[:2])


@dataclass(frozen=True)
class FieldSamples:
    """The field at points along rays."""

    sdf: Tensor
    """(r, s) signed distance in truncation units, not clipped; + outside."""
    colour: Tensor | None
    """(r, s, 3) in [0, 1], blended from the views; None where it was not asked for."""
    num_seen: Tensor
    """(r, s) how many views see the point."""


def order_encoding(num: int, like: Tensor) -> Tensor:
    """Sinusoids (num, 8) of the place of a sample on its ray: from half a wave per ray down to a sixteenth.

    The usual base of 10000 has six waves in 40 samples, and the field followed them: floating slabs with the
    slope that Eikonal asks for and the opacity that carving asks for (docs/training_log.md).
    """
    place = torch.arange(num, device=like.device, dtype=like.dtype).unsqueeze(1) / num
    rate = torch.pi / 2 ** torch.arange(ORDER_DIM // 2, device=like.device, dtype=like.dtype)
    return torch.cat([torch.sin(place * rate), torch.cos(place * rate)], dim=1)


def position_encoding(points: Tensor) -> Tensor:
    """Points (p, 3) in metres and the sines and cosines of 1, 2 and 4 times them: (p, 21)."""
    waves = [f(k * points) for k in POSITION_FREQUENCIES for f in (torch.sin, torch.cos)]
    return torch.cat([points, *waves], dim=1)


def table_distance(heights: Tensor, workspace: Workspace) -> Tensor:
    """The truncated distance to the empty table at heights above the workspace's floor, in [-1, 1].

    The network predicts what to add to it: it starts from an empty table instead of from nothing.
    """
    return ((heights - workspace.table_height) / workspace.truncation).clamp(-1, 1)


class SdfField(nn.Module):
    """Signed distance (Eqs. 5, 6, 8, 9) and blended colour."""

    def __init__(self, config: ModelConfig):
        super().__init__()
        self.config = config
        dims = config.token_dims
        self.view_transformers = nn.ModuleList([ViewTransformer(dim, config.heads) for dim in dims])
        fused = config.fused_dim
        self.fusion = nn.Sequential(
            nn.Linear(sum(dims), config.fusion_hidden),
            nn.ReLU(),
            nn.Linear(config.fusion_hidden, fused),
            nn.ReLU(),
        )
        self.position = nn.Sequential(
            nn.Linear(fused + 21, fused + ORDER_DIM),
            nn.ReLU(),
            nn.Linear(fused + ORDER_DIM, fused),
            nn.ReLU(),
        )
        self.ray_transformer = RayTransformer(fused + ORDER_DIM, config.heads)
        self.decoder = nn.Sequential(
            nn.Linear(fused + ORDER_DIM, 32), nn.ReLU(), nn.Linear(32, 16), nn.ReLU(), nn.Linear(16, 1)
        )
        widths = (sum(dims) + 4, 64, 32, 16, 8)
        hidden = [(nn.Linear(a, b), nn.ReLU()) for a, b in itertools.pairwise(widths)]
        self.blending = nn.Sequential(*itertools.chain(*hidden), nn.Linear(widths[-1], 1))

    def fuse(self) -> None:
        """Computes the view transformers with `fused` passes from now on."""
        passes = fused()
        for module in self.view_transformers:
            if isinstance(module, ViewTransformer):
                module.passes = passes

    def forward(self, scene: EncodedViews, points: Tensor, eye: Tensor | None = None) -> FieldSamples:
        """The field at points (r, s, 3): r sequences ("rays") of s samples, ordered along the ray.

        With `eye`, the centre (3,) of the camera that looks along the rays, colours come too.
        """
        num, samples, _ = points.shape
        order = order_encoding(samples, points)
        maps, volumes = Table.of_maps(torch.cat(scene.maps, dim=1)), Table.of(scene.volumes.flatten(0, 2))
        images = Table.of_images(scene.images)

        def field(start: int, stop: int) -> tuple[Tensor, ...]:
            flat = points[start:stop].flatten(0, 1)
            pixels, seen = scene.cameras.project(flat)
            corners = scene.cameras.corners(pixels, scene.maps[0].shape).where(seen)
            within = volume_corners(scene.workspace.to_unit(flat), scene.workspace.resolution)
            places = Places(points[start:stop], self._tokens(maps, corners, within.read(volumes)), seen)
            sdf, views = self._along(places, order, scene.workspace, need_views=eye is not None)
            if eye is None or views is None:
                return sdf, places.num_seen
            colours = scene.cameras.corners(pixels, scene.images.shape).read(images)
            weights = self._blending_weights(views, scene.cameras, places, eye)
            return sdf, places.num_seen, (weights * colours).sum(0).reshape(places.points.shape)

        learns = [maps.values, volumes.values, *self.parameters()]
        sdf, num_seen, *colour = in_chunks(field, num, points.device, samples, learns)
        return FieldSamples(sdf, colour[0] if colour else None, num_seen)

    def on_grid(self, scene: EncodedViews, voxels: Corners, seen: Tensor) -> Tensor:
        """Signed distance (r, r, r) at the voxel centres, whose places (n, r^3) in the maps are known.

        Every column is a ray seen from straight above: its samples count from the top down.
        """
        edge = scene.workspace.resolution
        columns = torch.from_numpy(scene.workspace.voxel_centres()).to(scene.volumes).flatten(0, 1)
        order = order_encoding(edge, columns).flip(0)
        maps, priors = Table.of_maps(torch.cat(scene.maps, dim=1)), scene.volumes.flatten(0, 2)

        def field(start: int, stop: int) -> tuple[Tensor, ...]:
            part = slice(start * edge, stop * edge)
            tokens = self._tokens(maps, voxels.part(part), priors[part])
            places = Places(columns[start:stop], tokens, seen[:, part])
            return self._along(places, order, scene.workspace, need_views=False)[:1]

        learns = [maps.values, priors, *self.parameters()]
        (sdf,) = in_chunks(field, edge**2, columns.device, edge, learns)
        return sdf.reshape(edge, edge, edge)

    def _tokens(self, maps: Table, corners: Corners, priors: Tensor) -> tuple[Tensor, ...]:
        """View tokens (n, p, d) of each branch: what its maps show, with its prior where it has one."""
        tokens = list(corners.read(maps).split(self.config.feature_dim, dim=-1))
        for index, prior in enumerate(priors.split(self.config.volume_dim, dim=-1)):
            shared = prior.to(tokens[index].dtype).expand(len(tokens[index]), -1, -1)
            tokens[index] = torch.cat([tokens[index], shared], dim=-1)
        return tuple(tokens)

    def _along(
        self, places: Places, order: Tensor, workspace: Workspace, need_views: bool
    ) -> tuple[Tensor, Tensor | None]:
        """Signed distance (r, s) along rays, and view features (n, r s, sum of dims) if needed."""
        branches = zip(self.view_transformers, places.tokens, strict=True)
        attended = [transformer(tokens, need_views) for transformer, tokens in branches]
        sdf = self._decode(torch.cat([unified for unified, _ in attended], dim=-1), places, order, workspace)
        return sdf, torch.cat([views for _, views in attended], dim=-1) if need_views else None

    def _decode(self, unified: Tensor, places: Places, order: Tensor, workspace: Workspace) -> Tensor:
        about_centre = places.points.flatten(0, 1) - torch.from_numpy(workspace.centre).to(order)
        x = self.fusion(unified)
        x = self.position(torch.cat([x, position_encoding(about_centre).to(x.dtype)], dim=-1))
        x = x.unflatten(0, places.points.shape[:2])
        x = torch.cat([x, order.to(x.dtype).expand(len(x), -1, -1)], dim=-1)
        x = self.ray_transformer(x, asks=places.num_seen > 1)
        sdf = self.decoder(x).squeeze(-1) + table_distance(places.points[..., 2], workspace)
        return torch.where(places.num_seen > 0, sdf, torch.ones_like(sdf))

    def _blending_weights(self, views: Tensor, cameras: CameraTensors, places: Places, eye: Tensor) -> Tensor:
        """How much each view's colour counts (n, p, 1): a softmax over the views that see the point."""
        flat = places.points.flatten(0, 1)
        towards_views = F.normalize(cameras.centres.unsqueeze(1) - flat, dim=-1)
        towards_eye = F.normalize(eye - flat, dim=-1)
        difference = towards_views - towards_eye
        cosine = (towards_views * towards_eye).sum(-1, keepdim=True)
        directions = torch.cat([difference, cosine], dim=-1).to(views.dtype)
        x = self.blending(torch.cat([views, directions], dim=-1))
        return torch.softmax(x.float().masked_fill(~places.seen.unsqueeze(-1), -1e9), dim=0)
