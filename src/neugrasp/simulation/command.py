"""`neugrasp generate` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal


@dataclass(frozen=True, kw_only=True)
class Generate:
    """Simulated scenes with photos, labelled grasps and ground truth. Goes on where it stopped."""

    doing: ClassVar[str] = "making scenes, up to a minute each"

    out: Path
    """Where the scenes are written: a folder, or the URL of an object store (docs/cluster.md)."""
    scene: Literal["packed", "pile", "single"] = "packed"
    """How the objects lie."""
    num: int = 100
    """Number of scenes in the folder when done."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    object_sets: tuple[str, ...] = ()
    """Of folder, pybullet and glassware; by default the folder of --objects, or without one the other two."""
    materials: Literal["mixed", "diffuse", "specular", "transparent", "transparent-specular"] = "mixed"
    """What the objects are made of."""
    photos: bool = True
    """Without photos scenes come several times faster and serve the grasp head alone."""
    stereo: bool = False
    """Also what a stereo depth sensor measures from each input view: what recipe swindr learns from. Takes
    some seconds a scene more."""
    targets: int = 2
    """Photos from the hemisphere for each scene, besides the inputs: what losses compare with."""
    samples: int = 4
    """Of a photo's pixel, a power of two: twice as many take twice the time, a fifth less noise remains."""
    views: str = "training"
    """Where the cameras stand: training, paper, released, ring6 or hemisphere6."""
    split: Literal["train", "test"] = "train"
    """Objects, panoramas and textures of the two never mix."""
    grasp_points: int = 120
    """Points of a scene at which grasps are executed."""
    scenes_per_cell: int = 8
    """Scenes that share a table, a room and cameras, and so the photos of the empty table."""
    image_size: int = 256
    """Pixels along each edge of a photo."""
    cube: float = 0.30
    """Edge of the workspace, metres. Weights see the cube that they were trained for, and nothing else."""
    resolution: int = 40
    """Voxels along it, a multiple of 8; one unit of a signed distance is four of them."""
    gripper: str = "panda"
    """The gripper that tries the grasps: a name of a bundled one, or a file."""
    seed: int = 0
    """The same seed gives the same scenes, whatever the number of workers."""
    workers: int | None = None
    """Processes that share the work; by default one per core."""
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
