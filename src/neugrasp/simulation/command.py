"""`neugrasp generate` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Generate:
    """Generates simulated scenes with photos, labelled grasps and ground truth. Continues where it
    stopped."""

    doing: ClassVar[str] = "making scenes, up to a minute each"

    out: Path
    """Folder for the scenes, or the URL of an object store (docs/cluster.md)."""
    scene: Literal["packed", "pile", "single"] = "packed"
    """Arrangement of the objects."""
    num: int = 100
    """Number of scenes in the folder when done."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    object_sets: tuple[str, ...] = ()
    """Sets to draw objects from: folder, pybullet, glassware. By default the folder of --objects, or
    without one the other two."""
    materials: Literal["mixed", "diffuse", "specular", "transparent", "transparent-specular"] = "mixed"
    """Materials of the objects."""
    photos: bool = True
    """Render photos. Without them scenes are made several times faster, and serve the grasp head alone."""
    stereo: bool = False
    """Also store what a stereo depth sensor measures from each input view; recipe swindr learns from it.
    Takes some seconds more for each scene."""
    targets: int = 2
    """Number of photos from the hemisphere for each scene, besides the inputs; losses compare renderings
    with them."""
    samples: int = 4
    """Render samples per pixel, a power of two. Doubling them doubles the time and cuts noise by a fifth."""
    views: str = "training"
    """Viewpoints of the cameras: training, paper, released, ring6 or hemisphere6."""
    split: Literal["train", "test"] = "train"
    """Split of objects, panoramas and textures; the two never mix."""
    grasp_points: int = 120
    """Number of points in a scene at which grasps are executed."""
    scenes_per_cell: int = 8
    """Number of scenes that share a table, a room and cameras, and so the photos of the empty table."""
    image_size: int = 256
    """Pixels along each edge of a photo."""
    cube: float = 0.30
    """Edge of the workspace, metres. Weights work only with the cube that they were trained for."""
    resolution: int = 40
    """Voxels along that edge, a multiple of 8; one unit of signed distance is four voxels."""
    gripper: str = "panda"
    """The gripper that tries the grasps: a name of a bundled one, or a file."""
    seed: int = 0
    """Random seed; the same seed gives the same scenes, whatever the number of workers."""
    workers: int | None = None
    """Number of processes that share the work; by default one per core."""
    cluster: str | None = None
    """Share the work with a Ray cluster: auto, or its address HOST:6379 (docs/cluster.md)."""

    @property
    def sets(self) -> tuple[str, ...]:
        """The object sets that are opened."""
        if self.object_sets:
            return self.object_sets
        return ("folder",) if self.objects is not None else ("pybullet", "glassware")

    def record_name(self, index: int) -> str:
        """Folder name of scene `index`."""
        return f"{self.scene}-{self.seed}-{index:06d}"
