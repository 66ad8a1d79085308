"""The cube in which grasps are sought: the one owner of its size, resolution, table height and truncation."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float, Float64, Int64
from numpy.typing import ArrayLike

from neugrasp.data.fields import Fields
from neugrasp.geometry.camera import Box, Camera
from neugrasp.geometry.pose import apply, is_rigid

if TYPE_CHECKING:
    from torch import Tensor


PHOTO_OUTLINE = ((0.0, 1.0), (1 / 3, 0.8), (2 / 3, 0.6))
"""What a crop must show: at a height above the table, in edges of the cube, a square about its middle, as a
part of the cube's. Objects rarely stand tall at the rim: 0.4 % of what is occupied in settled scenes lies
outside, and the crop is 1.4 times narrower than one of the whole cube up to half its height."""

LENGTHS = ("size", "table_height", "truncation", "photo_height")
"""Fields of a workspace in metres."""


@dataclass(frozen=True)
class Workspace:
    """A cube of space divided into voxels. Its frame: origin at the lower corner, z up, metres."""

    size: float = 0.30
    """Edge length in metres."""
    resolution: int = 40
    """Voxels per edge."""
    table_height: float = 0.05
    """z of the table plane in the workspace frame, metres."""
    truncation: float = 0.03
    """Metres that one unit of a signed distance stands for."""
    photo_height: float = 0.15
    """Height above the table, in metres, up to which objects are expected: where the doctor and the checks of
    cameras look."""
    world_from_workspace: Float[np.ndarray, "4 4"] = field(default_factory=lambda: np.eye(4))

    @property
    def up(self) -> tuple[float, float, float]:
        """Unit vector away from the table, in the user's world."""
        x, y, z = self.world_from_workspace[:3, 2].tolist()
        return x, y, z

    @property
    def voxel_size(self) -> float:
        """Edge of a voxel in metres."""
        return self.size / self.resolution

    @property
    def cube(self) -> tuple[float, int, float, float]:
        """Size, resolution, table height and truncation: everything but its place in the world."""
        return (self.size, self.resolution, self.table_height, self.truncation)

    @classmethod
    def with_edge(cls, size: float, resolution: int) -> Workspace:
        """A cube of another size or resolution; a signed distance of 1 stays four voxels, the table where it
        is. Raises `InputError` where the network could not take it."""
        plain = {"size": size, "resolution": resolution, "truncation": 4 * size / resolution}
        return cls.from_dict(plain, "the cube")

    def unusual(self) -> dict[str, float | int]:
        """What of the cube is not as in `USUAL`: what files write down beside its place."""
        names = ("size", "resolution", "table_height", "truncation")
        return {name: getattr(self, name) for name in names if getattr(self, name) != getattr(USUAL, name)}

    def describe(self) -> str:
        """The cube in words, for messages."""
        return (
            f"a cube of {self.size:g} m with {self.resolution} voxels an edge, its table at "
            f"{self.table_height:g} m and a truncation of {self.truncation:g} m"
        )

    def to_dict(self) -> dict[str, Any]:
        """The fields as plain data."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        return plain | {"world_from_workspace": np.asarray(self.world_from_workspace).tolist()}

    @classmethod
    def from_dict(cls, data: Any, source: str = "a workspace") -> Workspace:
        """The reverse of `to_dict`; what is missing is as usual. Raises `InputError` naming `source`."""
        given = data if isinstance(data, Fields) else Fields(source, data)
        given.only(field.name for field in fields(cls))
        plain: dict[str, Any] = {
            name: given.number(name, 1e-3, 10, "metres") for name in LENGTHS if name in given.data
        }
        if "resolution" in given.data:
            plain["resolution"] = given.whole("resolution", 8, 256)
            if plain["resolution"] % 8:
                raise given.refuse("resolution", f"is {plain['resolution']}; it must be a multiple of 8")
        if "world_from_workspace" in given.data:
            pose = given.rows("world_from_workspace", 4, 1e9, "a 4 x 4 matrix")
            if pose.shape != (4, 4) or not is_rigid(pose):
                raise given.refuse("world_from_workspace", "is no rotation and translation in metres")
            plain["world_from_workspace"] = pose
        return cls(**plain)

    @property
    def centre(self) -> Float64[np.ndarray, " 3"]:
        """The middle of the table inside the cube, in the workspace frame: where cameras look."""
        return np.array([self.size / 2, self.size / 2, self.table_height])

    def corners(self, bottom: float = 0.0, top: float | None = None) -> Float64[np.ndarray, "8 3"]:
        """The 8 corners of the cube, or of its slice between two heights, workspace frame."""
        top = self.size if top is None else top
        low, high = np.array([0.0, 0.0, bottom]), np.array([self.size, self.size, top])
        choice = np.stack(np.meshgrid([0, 1], [0, 1], [0, 1], indexing="ij"), -1).reshape(8, 3)
        return np.where(choice == 1, high, low)

    def voxel_centres(self) -> Float64[np.ndarray, "r r r 3"]:
        """Positions of the voxels [x, y, z]: (i + 0.5) voxel sizes."""
        axis = (np.arange(self.resolution) + 0.5) * self.voxel_size
        return np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1)

    def index_of(self, points: ArrayLike) -> Int64[np.ndarray, "*points 3"]:
        """Voxel indices of workspace points (..., 3); the caller checks `contains` first."""
        return np.floor(np.asarray(points, dtype=np.float64) / self.voxel_size).astype(np.int64)

    def position_of(self, index: ArrayLike) -> Float64[np.ndarray, "*shape"]:
        """Workspace positions of voxel indices along any axis, whole or fractional: i is a voxel's centre."""
        return np.asarray((np.asarray(index, dtype=np.float64) + 0.5) * self.voxel_size)

    def contains(self, points: ArrayLike) -> Bool[np.ndarray, "*points"]:
        """Whether workspace points (..., 3) lie in the cube."""
        points = np.asarray(points)
        return np.asarray(np.all((points >= 0) & (points < self.size), axis=-1))

    def to_unit(self, points: Float[Tensor, "*points 3"]) -> Float[Tensor, "*points 3"]:
        """Workspace metres to the [-1, 1] cube whose faces are the cube's faces."""
        return points * (2 / self.size) - 1

    def photo_box(self, camera: Camera) -> Box:
        """The square of the photo, in pixels, that shows the cube; `camera` in the workspace frame.

        The projection of `PHOTO_OUTLINE` and of what lies just under the table, cut to the sensor, then
        widened to a square about its middle. It reaches past the photo where that is not square.
        """
        pixels, depth = camera.project(self._photo_outline())
        seen = camera.bounds
        if np.any(depth < 0.01):
            left, top, right, bottom_edge = seen
        else:
            left, top = np.maximum(pixels.min(axis=0), seen[:2])
            right, bottom_edge = np.minimum(pixels.max(axis=0), seen[2:])
        if right - left < 2 or bottom_edge - top < 2:
            return seen
        side = max(right - left, bottom_edge - top)
        u, v = (left + right) / 2, (top + bottom_edge) / 2
        return (u - side / 2, v - side / 2, u + side / 2, v + side / 2)

    def _photo_outline(self) -> np.ndarray:
        """Corners (n, 3) of the squares of `PHOTO_OUTLINE`, the lowest one 1 cm under the table."""
        signs = np.array([(-1, -1), (-1, 1), (1, -1), (1, 1)])
        squares = []
        for height, part in PHOTO_OUTLINE:
            z = self.table_height + height * self.size - (0.01 if height == 0 else 0)
            across = self.size / 2 * (1 + part * signs)
            squares.append(np.column_stack([across, np.full(4, z)]))
        return np.concatenate(squares)

    def to_world(self, points: ArrayLike) -> Float64[np.ndarray, "*points 3"]:
        """Workspace points (..., 3) in the world."""
        return apply(self.world_from_workspace, points)


USUAL = Workspace()
"""The cube of the paper: what files are about that do not say otherwise."""
