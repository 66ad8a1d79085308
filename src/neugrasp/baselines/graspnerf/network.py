"""GraspNeRF: photos -> features -> signed distance -> TSDF -> grasps."""

from __future__ import annotations

import torch
from torch import Tensor, nn

from neugrasp.baselines.graspnerf.aggregation import Aggregation
from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.baselines.graspnerf.encoders import Encoders
from neugrasp.baselines.graspnerf.scene import PhotographedScene
from neugrasp.baselines.graspnerf.visibility import RayEndDecoder
from neugrasp.geometry.sampling import LookupTable
from neugrasp.geometry.workspace import USUAL, Workspace
from neugrasp.model.chunked import map_chunked
from neugrasp.model.config import ModelConfig
from neugrasp.model.field import order_encoding
from neugrasp.model.grasp_head import GraspHead, GraspVolume
from neugrasp.model.inputs import ViewTensors
from neugrasp.model.network import Reconstruction
from neugrasp.model.rendering import Rays, Rendered, composite, importance_samples, stratified_samples


class Pass(nn.Module):
    """What reads the scene at points: there is one for the grid and for coarse samples, one for fine ones."""

    def __init__(self, config: GraspNerfConfig):
        super().__init__()
        self.ends = RayEndDecoder(config.feature_dim)
        self.aggregation = Aggregation(config)


class GraspNerf(nn.Module):
    """The network; it sees photos alone."""

    def __init__(self, config: GraspNerfConfig, workspace: Workspace | None = None):
        super().__init__()
        self.config = config
        self.workspace = workspace or USUAL
        self.encoders = Encoders(config)
        self.coarse, self.fine = Pass(config), Pass(config)
        self.head = GraspHead(ModelConfig(head_channels=config.head_channels))
        # exp(10 v) = 100 per metre at the start (docs/reproduction.md).
        self.log_sharpness = nn.Parameter(torch.tensor(0.46))

    def forward(self, views: ViewTensors) -> tuple[Reconstruction[PhotographedScene], GraspVolume]:
        """Surface and grasps from photos."""
        reconstruction = self.reconstruct(self.encode(views))
        return reconstruction, self.head(reconstruction.tsdf.unsqueeze(0))

    def encode(self, views: ViewTensors) -> PhotographedScene:
        """What the field reads."""
        maps = self.encoders(views.images).float()
        images, table = LookupTable.of_images(views.images), LookupTable.of_maps(maps)
        return PhotographedScene(images, table, maps.shape, views.cameras, self.config)

    def reconstruct(self, scene: PhotographedScene) -> Reconstruction[PhotographedScene]:
        """The field at all voxels."""
        edge = self.workspace.resolution
        return Reconstruction(scene, *self.sdf_window(scene, slice(edge), slice(edge)))

    def sdf_window(self, scene: PhotographedScene, x: slice, y: slice) -> tuple[Tensor, Tensor]:
        """Signed distance (x, y, r), not clipped, at the voxels of a part of the cube, and which are seen.

        Every column is a ray seen from straight above: its samples count from the top down.
        """
        centres = scene.images.values.new_tensor(self.workspace.voxel_centres()[x, y])
        columns = centres.flatten(0, 1)
        order = order_encoding(columns.shape[1], columns, self.config.ray_dim).flip(0)
        lengths = columns.new_full((), self.workspace.voxel_size)
        above = columns.new_tensor([0.0, 0.0, 1.0])

        def query(part: slice) -> tuple[Tensor, ...]:
            points = columns[part]
            at = scene.at(points, lengths.expand(points.shape[:2]), above, self.coarse.ends)
            return self.coarse.aggregation(at, self.workspace, order)[0], at.num_seen > 0

        sdf, seen = map_chunked(query, len(columns), columns.shape[1], columns.device)
        return sdf.reshape(centres.shape[:3]), seen.reshape(centres.shape[:3])

    def sharpness(self, _scheduled: float = 0.0) -> Tensor:
        """NeuS sharpness in 1 / metre: learned, whatever a schedule says."""
        return torch.exp(10 * self.log_sharpness).clamp(1e-6, 1e6)

    def render(
        self,
        scene: PhotographedScene,
        rays: Rays,
        sharpness: Tensor,
        generator: torch.Generator | None = None,
    ) -> tuple[Rendered, Rendered]:
        """Coarse and fine renderings of rays; with a generator, samples are jittered."""
        coarse_at = stratified_samples(rays, self.config.coarse_samples, generator)
        coarse = self._render(scene, rays, coarse_at, sharpness, self.coarse)
        fine_at = importance_samples(coarse_at, coarse.weights, self.config.fine_samples, generator)
        return coarse, self._render(scene, rays, fine_at, sharpness, self.fine)

    def _render(
        self, scene: PhotographedScene, rays: Rays, distances: Tensor, sharpness: Tensor, reader: Pass
    ) -> Rendered:
        points = rays.points(distances)
        steps = distances.diff(dim=1)
        lengths = torch.cat([steps, steps[:, -1:]], dim=1)
        order = order_encoding(distances.shape[1], distances, self.config.ray_dim)

        def query(part: slice) -> tuple[Tensor, ...]:
            back = -rays.directions[part].unsqueeze(1)
            at = scene.at(points[part], lengths[part], back, reader.ends)
            return reader.aggregation(at, self.workspace, order)

        sdf, colour = map_chunked(query, len(points), points.shape[1], points.device)
        return composite(sdf * self.workspace.truncation, colour, distances, sharpness)
