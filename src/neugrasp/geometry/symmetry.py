"""The eight symmetries of the workspace, by which scenes, photos, grids and grasps move together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Float64, Shaped
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from neugrasp.geometry.camera import Camera
from neugrasp.geometry.workspace import Workspace


@dataclass(frozen=True)
class Symmetry:
    """Quarter turns about the vertical through the middle of the cube, after an optional mirroring of x."""

    turns: int = 0
    mirrored: bool = False

    @classmethod
    def random(cls, rng: np.random.Generator) -> Symmetry:
        """One of the eight."""
        return cls(int(rng.integers(4)), bool(rng.integers(2)))

    @property
    def inverse(self) -> Symmetry:
        """What undoes it. A turn after a mirroring is a mirroring about another plane, and undoes itself."""
        return self if self.mirrored else Symmetry(-self.turns % 4)

    def matrix(self, workspace: Workspace) -> Float64[np.ndarray, "4 4"]:
        """A map of workspace points; its determinant is -1 where mirrored."""
        turn = np.round(Rotation.from_euler("z", 90 * self.turns, degrees=True).as_matrix())
        linear = turn @ np.diag([-1.0 if self.mirrored else 1.0, 1.0, 1.0])
        middle = np.array([workspace.size / 2, workspace.size / 2, 0.0])
        matrix = np.eye(4)
        matrix[:3, :3] = linear
        matrix[:3, 3] = middle - linear @ middle
        return matrix

    def of_grid(self, grid: Shaped[np.ndarray, "r r r *rest"]) -> Shaped[np.ndarray, "r r r *rest"]:
        """A grid [x, y, z] of the moved scene."""
        flipped = grid[::-1] if self.mirrored else grid
        return np.ascontiguousarray(np.rot90(flipped, self.turns, axes=(0, 1)))

    def of_image(
        self, image: Shaped[np.ndarray, "height width *rest"]
    ) -> Shaped[np.ndarray, "height width *rest"]:
        """The photo that the moved camera takes: mirrored left to right, or as it is."""
        return np.ascontiguousarray(image[:, ::-1]) if self.mirrored else image

    def of_camera(self, camera: Camera, workspace: Workspace) -> Camera:
        """The camera that takes `of_image`. A mirrored frame becomes right-handed by turning its x axis."""
        pose = self.matrix(workspace) @ camera.world_from_camera
        if not self.mirrored:
            return replace(camera, world_from_camera=pose)
        intrinsics = camera.intrinsics.copy()
        intrinsics[0, 2] = camera.width - 1 - intrinsics[0, 2]
        intrinsics[0, 1] = -intrinsics[0, 1]
        left, top, right, bottom = camera.bounds
        sensed = (camera.width - 1 - right, top, camera.width - 1 - left, bottom)
        mirror = np.diag([-1.0, 1.0, 1.0, 1.0])
        return replace(camera, intrinsics=intrinsics, world_from_camera=pose @ mirror, sensed=sensed)

    def of_rotations(self, quaternions: ArrayLike) -> Float[np.ndarray, "*grasps 4"]:
        """Orientations (..., 4), xyzw, of the moved grasps; the gripper is its own mirror image in x.

        With M the mirroring of x, R becomes turn M R M, and M R M has the quaternion (x, -y, -z, w).
        """
        x, y, z, w = np.moveaxis(np.asarray(quaternions), -1, 0)
        if self.mirrored:
            y, z = -y, -z
        angle = math.pi / 4 * self.turns
        s, c = math.sin(angle), math.cos(angle)
        return np.stack([c * x - s * y, c * y + s * x, c * z + s * w, c * w - s * z], axis=-1)


SYMMETRIES = tuple(Symmetry(turns, mirrored) for mirrored in (False, True) for turns in range(4))
"""All eight; the first leaves everything as it is."""
