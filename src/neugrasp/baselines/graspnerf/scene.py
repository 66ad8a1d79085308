"""A photographed scene as GraspNeRF reads it at points."""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from neugrasp.baselines.graspnerf.aggregation import ViewedPoints
from neugrasp.baselines.graspnerf.config import GraspNerfConfig
from neugrasp.baselines.graspnerf.visibility import RayEndDecoder, scaled_inverse, scaled_length
from neugrasp.geometry.sampling import CameraTensors, LookupTable


@dataclass(frozen=True)
class PhotographedScene:
    """Photos, their features and cameras."""

    images: LookupTable
    """(n s s, 3) RGB."""
    maps: LookupTable
    """(n h w, 2 d) image features, then ray features."""
    map_shape: torch.Size
    """(n, 2 d, h, w)"""
    cameras: CameraTensors
    config: GraspNerfConfig

    def at(self, points: Tensor, lengths: Tensor, towards: Tensor, ends: RayEndDecoder) -> ViewedPoints:
        """The scene at points (r, s, 3), each the middle of an interval of `lengths` (r, s), metres.

        `towards` (r, s, 3), or what expands to it, are unit vectors from the points to whoever looks.
        """
        flat = points.flatten(0, 1)
        pixels, seen = self.cameras.project(flat)
        width, height = self.cameras.size
        photos = torch.Size((len(seen), 3, height, width))
        colours = self.cameras.interpolation(pixels, photos).where(seen).read(self.images)
        maps = self.cameras.interpolation(pixels, self.map_shape).where(seen).read(self.maps)
        features, rays = maps.chunk(2, dim=-1)
        depths = self.cameras.depths(flat)
        scale = self.config.nearest, self.config.farthest
        places = scaled_inverse(depths, *scale)
        reached, hit = ends(rays).seen_and_hit(places, scaled_length(lengths.flatten(), depths, *scale))
        rays = torch.cat([rays, torch.stack([reached, hit], dim=-1).to(rays.dtype)], dim=-1)
        return ViewedPoints(points, colours, features, rays, self._directions(points, towards), seen)

    def _directions(self, points: Tensor, towards: Tensor) -> Tensor:
        """(n, r s, 4): the difference of the unit vectors to the views and `towards`, and their cosine."""
        flat = points.flatten(0, 1)
        views = F.normalize(self.cameras.centres.unsqueeze(1) - flat, dim=-1)
        looked = towards.expand_as(points).flatten(0, 1)
        return torch.cat([views - looked, (views * looked).sum(-1, keepdim=True)], dim=-1)
