"""Features and volumes -> signed distance and colour at any point (Eqs. 5, 6, 8, 9)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor, nn

from neugrasp.geometry.sampling import CameraTensors, InterpolationIndex, LookupTable, volume_interpolation
from neugrasp.geometry.workspace import Workspace
from neugrasp.model.attention import RayTransformer, ViewTransformer
from neugrasp.model.config import ModelConfig

ORDER_DIM = 8
POSITION_FREQUENCIES = (1.0, 2.0, 4.0)


@dataclass(frozen=True)
class PointSamples:
    """Points along rays and what the scene shows there."""

    points: Float[Tensor, "rays samples 3"]
    """Workspace metres."""
    maps: Float[Tensor, "views rays*samples features"]
    """Features of the views: scene, then foreground where the model has it."""
    priors: Float[Tensor, "rays*samples priors"]
    """Shape prior, then occupancy prior where the model has one."""
    seen: Bool[Tensor, "views rays*samples"]
    """Which views see which point."""
    colours: Float[Tensor, "views rays*samples 3"] | None = None
    """Colours of the views' photos, in [0, 1], where they were asked for."""

    @property
    def num_seen(self) -> Int[Tensor, "rays samples"]:
        """How many views see each point."""
        return self.seen.sum(0).reshape(self.points.shape[:2])


@dataclass(frozen=True)
class EncodedViews:
    """A scene as the field reads it."""

    images: LookupTable
    """RGB of the pixels of all views, for the colours."""
    maps: LookupTable
    """Scene features, then foreground features where the model has them."""
    map_shape: torch.Size
    """Views, channels of the scene features, height, width."""
    priors: LookupTable
    """The shape prior at the voxels, then the occupancy prior where the model has one."""
    voxels: InterpolationIndex
    """Places (views, voxels) of the voxel centres [x, y, z] in the maps."""
    seen: Bool[Tensor, "views voxels"]
    """Which views see which voxel."""
    centres: Float[Tensor, "voxels 3"]
    """Centres of the voxels [x, y, z], workspace metres."""
    cameras: CameraTensors
    workspace: Workspace

    def at_points(self, points: Float[Tensor, "rays samples 3"], colours: bool = False) -> PointSamples:
        """The scene at points; gradients reach the points and the cameras, too."""
        flat = points.flatten(0, 1)
        pixels, seen = self.cameras.project(flat)
        in_maps = self.cameras.interpolation(pixels, self.map_shape).where(seen)
        in_volume = volume_interpolation(self.workspace.to_unit(flat), self.workspace.resolution)
        width, height = self.cameras.size
        photos = torch.Size((len(seen), 3, height, width))
        rgb = self.cameras.interpolation(pixels, photos).read(self.images) if colours else None
        return PointSamples(points, in_maps.read(self.maps), in_volume.read(self.priors), seen, rgb)

    def at_columns(self, columns: slice | Int[Tensor, " columns"]) -> PointSamples:
        """The scene at the voxel centres of some columns x r + y: rays that point upwards."""
        edge = self.workspace.resolution
        centres = self.centres.unflatten(0, (-1, edge))[columns]
        if isinstance(columns, slice):
            voxels: slice | Tensor = slice(columns.start * edge, columns.stop * edge)
        else:
            voxels = (columns.unsqueeze(1) * edge + torch.arange(edge, device=columns.device)).flatten()
        maps = self.voxels.part(voxels).read(self.maps)
        return PointSamples(centres, maps, self.priors.values[voxels], self.seen[:, voxels])


def order_encoding(num: int, like: Float[Tensor, "*_"], dim: int = ORDER_DIM) -> Float[Tensor, "{num} {dim}"]:
    """Sinusoids of the place of a sample on its ray: from half a wave per ray down, by halves.

    The usual base of 10000 has six waves in 40 samples, and the field followed them: floating slabs with the
    slope that Eikonal asks for and the opacity that carving asks for (docs/training_log.md).
    """
    place = torch.arange(num, device=like.device, dtype=like.dtype).unsqueeze(1) / num
    rate = torch.pi / 2 ** torch.arange(dim // 2, device=like.device, dtype=like.dtype)
    return torch.cat([torch.sin(place * rate), torch.cos(place * rate)], dim=1)


def position_encoding(points: Float[Tensor, "points 3"]) -> Float[Tensor, "points 21"]:
    """Points in metres and the sines and cosines of 1, 2 and 4 times them."""
    turns = points.unsqueeze(1) * points.new_tensor(POSITION_FREQUENCIES).unsqueeze(1)
    waves = torch.stack([turns.sin(), turns.cos()], dim=2)
    return torch.cat([points, waves.flatten(1)], dim=1)


def table_distance(heights: Float[Tensor, "*shape"], workspace: Workspace) -> Float[Tensor, "*shape"]:
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

    def forward(
        self,
        samples: PointSamples,
        workspace: Workspace,
        order: Float[Tensor, "samples 8"] | None = None,
    ) -> tuple[Float[Tensor, "rays samples"], tuple[Float[Tensor, "views points _"], ...]]:
        """Signed distance in truncation units at sequences ("rays") of samples, + outside.

        `order` encodes the place of a sample on its ray; by default they come in the order of the ray.
        The second value holds the re-weighted view features of each branch where the samples have
        colours, for `blend`, and nothing otherwise.
        """
        blends = samples.colours is not None
        branches = zip(self.view_transformers, self._tokens(samples), strict=True)
        attended = [transformer(tokens, need_views=blends) for transformer, tokens in branches]
        unified = torch.cat([unified for unified, _ in attended], dim=-1)
        x = self._with_position(self.fusion(unified), samples.points, workspace)
        if order is None:
            order = order_encoding(samples.points.shape[1], samples.points)
        x = torch.cat([x, order.to(x.dtype).expand(len(x), -1, -1)], dim=-1)
        x = self.ray_transformer(x, query_mask=samples.num_seen > 1)
        sdf = self.decoder(x).squeeze(-1) + table_distance(samples.points[..., 2], workspace)
        sdf = torch.where(samples.num_seen > 0, sdf, torch.ones_like(sdf))
        return sdf, tuple(views for _, views in attended if views is not None)

    def blend(
        self,
        samples: PointSamples,
        views: tuple[Float[Tensor, "views points _"], ...],
        cameras: CameraTensors,
        eyes: Float[Tensor, "rays 3"],
    ) -> Float[Tensor, "rays samples 3"]:
        """Colours as seen from `eyes`: a softmax over the views that see a point.

        Raises `ValueError` on samples without colours.
        """
        if samples.colours is None:
            raise ValueError("samples without colours cannot be blended; ask `at_points` for them")
        flat = samples.points.flatten(0, 1)
        towards_views = F.normalize(cameras.centres.unsqueeze(1) - flat, dim=-1)
        towards_eye = F.normalize(eyes.unsqueeze(1) - samples.points, dim=-1).flatten(0, 1)
        difference = towards_views - towards_eye
        cosine = (towards_views * towards_eye).sum(-1, keepdim=True)
        directions = torch.cat([difference, cosine], dim=-1).to(views[0].dtype)
        x = self.blending(torch.cat([*views, directions], dim=-1)).float()
        weights = torch.softmax(x.masked_fill(~samples.seen.unsqueeze(-1), -1e9), dim=0)
        return (weights * samples.colours).sum(0).reshape(samples.points.shape)

    def _tokens(self, samples: PointSamples) -> list[Tensor]:
        """View tokens (n, p, d) of each branch: what its maps show, with its prior where it has one."""
        tokens = list(samples.maps.split(self.config.feature_dim, dim=-1))
        for index, prior in enumerate(samples.priors.split(self.config.volume_dim, dim=-1)):
            shared = prior.to(tokens[index].dtype).expand(len(tokens[index]), -1, -1)
            tokens[index] = torch.cat([tokens[index], shared], dim=-1)
        return tokens

    def _with_position(self, x: Tensor, points: Tensor, workspace: Workspace) -> Tensor:
        """Features (r s, d) of points (r, s, 3), told where they are: (r, s, d)."""
        about_centre = points.flatten(0, 1) - points.new_tensor(workspace.centre)
        x = self.position(torch.cat([x, position_encoding(about_centre).to(x.dtype)], dim=-1))
        return x.unflatten(0, points.shape[:2])
