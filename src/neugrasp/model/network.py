"""The whole network: photos -> features -> volumes -> signed distance -> TSDF -> grasps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic, TypeVar

import torch
from einops import rearrange
from jaxtyping import Bool, Float, Float32, Int
from torch import Tensor, nn

from neugrasp.geometry.sampling import LookupTable, sample_volume
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.model.chunked import map_chunked
from neugrasp.model.config import ModelConfig
from neugrasp.model.features import FeatureNet, ImageDifference, ResidualAttention
from neugrasp.model.field import EncodedViews, SdfField, order_encoding
from neugrasp.model.grasp_head import GraspHead, GraspVolume
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.rendering import (
    Rays,
    Rendered,
    composite,
    importance_samples,
    ray_weights,
    stratified_samples,
)
from neugrasp.model.volumes import VolumeNet

GRID_SAMPLES = 64
"""Samples on a ray through the grid: about one for every voxel that it meets."""


Map = Float[Tensor, "views channels height width"]
"""Features of every view."""
Maps = tuple[Map, ...]
Scene = TypeVar("Scene")


@dataclass(frozen=True)
class Reconstruction(Generic[Scene]):
    """A scene as a network reads it, its signed distance on the grid, and where it was seen."""

    scene: Scene
    sdf: Float[Tensor, "r r r"]
    """Truncation units, not clipped."""
    seen: Bool[Tensor, "r r r"]
    """Whether any view sees the voxel."""

    @property
    def tsdf(self) -> Float[Tensor, "r r r"]:
        """The truncated signed distance, in [-1, 1]."""
        return self.sdf.clamp(-1, 1)


class NeuGrasp(nn.Module):
    """The network of the paper; `config` switches its ablations."""

    def __init__(self, config: ModelConfig, workspace: Workspace | None = None):
        super().__init__()
        self.config = config
        self.workspace = workspace or USUAL
        self.features = FeatureNet(config)
        uses_attention = config.use_backgrounds and config.use_residual_attention
        self.residual = ResidualAttention(config.feature_dim) if uses_attention else None
        uses_change = config.use_backgrounds and config.use_change
        self.change = ImageDifference(config.feature_dim) if uses_change else None
        self.volumes = VolumeNet(config)
        self.field = SdfField(config)
        self.head = GraspHead(config)
        if config.learned_sharpness:
            # exp(10 v) = 100 per metre at the start (docs/reproduction.md).
            self.log_sharpness = nn.Parameter(torch.tensor(0.46))

    def forward(self, views: ViewTensors) -> tuple[Reconstruction[EncodedViews], GraspVolume]:
        """Surface and grasps from photos."""
        reconstruction = self.reconstruct(self.encode(views.images), self.encode_backgrounds(views), views)
        return reconstruction, self.head(reconstruction.tsdf.unsqueeze(0))

    def encode(
        self, images: Float[Tensor, "images 3 size size"]
    ) -> Float32[Tensor, "images channels size//4 size//4"]:
        """Feature maps of images."""
        maps: Tensor = self.features(images)
        return maps.float()

    def encode_backgrounds(self, views: ViewTensors) -> Map | None:
        """Feature maps of the backgrounds, which may be kept for as long as the cell stays as it is."""
        return self.encode(views.backgrounds) if self.config.use_backgrounds else None

    def reconstruct(
        self, scene: Map, background: Map | None, views: ViewTensors
    ) -> Reconstruction[EncodedViews]:
        """The field and its values on the grid, from the feature maps of photos and backgrounds."""
        encoded = self.encode_scene(scene, background, views)
        sdf = self.sdf_columns(encoded).reshape((self.workspace.resolution,) * 3)
        return Reconstruction(encoded, sdf, encoded.seen.any(0).reshape(sdf.shape))

    def encode_scene(self, scene: Map, background: Map | None, views: ViewTensors) -> EncodedViews:
        """What the field reads: feature maps and prior volumes (Eq. 7 and the two priors of Fig. 2)."""
        maps, prior_maps = self._field_maps(scene, background, views)
        centres = scene.new_tensor(self.workspace.voxel_centres()).reshape(-1, 3)
        pixels, seen = views.cameras.project(centres)
        voxels = views.cameras.interpolation(pixels, scene.shape).where(seen)
        volumes = rearrange(self.volumes(prior_maps, voxels, seen), "k c x y z -> (x y z) (k c)").float()
        return EncodedViews(
            LookupTable.of_images(views.images),
            LookupTable.of_maps(torch.cat(maps, dim=1)),
            scene.shape,
            LookupTable.of(volumes),
            voxels,
            seen,
            centres,
            views.cameras,
            self.workspace,
        )

    def sdf_columns(
        self, scene: EncodedViews, columns: Int[Tensor, " columns"] | None = None
    ) -> Float[Tensor, "columns {self.workspace.resolution}"]:
        """Signed distance, not clipped, at the voxels of columns, numbered x r + y; by default of all.

        Every column is a ray seen from straight above: its samples count from the top down.
        """
        edge = self.workspace.resolution
        order = order_encoding(edge, scene.centres).flip(0)

        def query(part: slice) -> tuple[Tensor, ...]:
            samples = scene.at_columns(part if columns is None else columns[part])
            return self.field(samples, self.workspace, order)[:1]

        num = edge**2 if columns is None else len(columns)
        return map_chunked(query, num, edge, scene.centres.device)[0]

    def _field_maps(self, scene: Map, background: Map | None, views: ViewTensors) -> tuple[Maps, Maps]:
        """What the view transformers read, and what the prior volumes are made from."""
        if background is None:
            return (scene,), (scene,)
        attended = scene if self.residual is None else self.residual(scene, background).float()
        residue = scene - background
        if self.change is not None:
            change = self.change(views.images, views.backgrounds).float()
            residue = residue + change
            attended = attended if self.residual is None else attended + change
        priors = (scene, residue) if self.config.use_occupancy_prior else (scene,)
        return (scene, attended), priors

    def sharpness(self, scheduled: float) -> Float[Tensor, ""]:
        """NeuS sharpness in 1 / metre: learned if the model learns it, else the schedule's value."""
        if self.config.learned_sharpness:
            return torch.exp(10 * self.log_sharpness).clamp(1e-6, 1e6)
        return next(self.parameters()).new_tensor(scheduled)

    def render(
        self,
        scene: EncodedViews,
        rays: Rays,
        sharpness: Float[Tensor, ""],
        generator: torch.Generator | None = None,
    ) -> tuple[Rendered, Rendered]:
        """Coarse and fine renderings of rays; with a generator, samples are jittered."""
        coarse_at = stratified_samples(rays, self.config.coarse_samples, generator)
        coarse = self.render_at(scene, rays, coarse_at, sharpness)
        fine_at = importance_samples(coarse_at, coarse.weights, self.config.fine_samples, generator)
        return coarse, self.render_at(scene, rays, fine_at, sharpness)

    def weights_on_grid(
        self,
        reconstruction: Reconstruction[EncodedViews],
        rays: Rays,
        sharpness: Float[Tensor, ""],
        generator: torch.Generator | None = None,
    ) -> tuple[Float[Tensor, "rays intervals"], Float[Tensor, "rays intervals"]]:
        """Weights of intervals on rays through the grid's distances, and their midpoints in metres."""
        distances = stratified_samples(rays, GRID_SAMPLES, generator)
        points = self.workspace.to_unit(rays.points(distances).reshape(-1, 3))
        sdf = sample_volume(reconstruction.sdf.unsqueeze(0), points).reshape(distances.shape)
        weights = ray_weights(sdf * self.workspace.truncation, sharpness)
        return weights, (distances[:, 1:] + distances[:, :-1]) / 2

    def render_at(
        self,
        scene: EncodedViews,
        rays: Rays,
        distances: Float[Tensor, "rays samples"],
        sharpness: Float[Tensor, ""],
    ) -> Rendered:
        """Renderings of rays from the field at given distances."""
        points = rays.points(distances)

        def query(part: slice) -> tuple[Tensor, ...]:
            samples = scene.at_points(points[part], colours=True)
            sdf, views = self.field(samples, self.workspace)
            return sdf, self.field.blend(samples, views, scene.cameras, rays.origins[part])

        sdf, colour = map_chunked(query, len(points), points.shape[1], points.device)
        return composite(sdf * self.workspace.truncation, colour, distances, sharpness)
