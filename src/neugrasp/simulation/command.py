"""`neugrasp generate` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, Literal

from neugrasp.terminal import next_step


@dataclass(frozen=True)
class Generate:
    """Simulated scenes with photos, labelled grasps and ground truth. Goes on where it stopped."""

    doing: ClassVar[str] = "making scenes, up to a minute each"

    out: Path
    """Where the scenes are written."""
    scene: Literal["packed", "pile", "single"] = "packed"
    """How the objects lie."""
    num: int = 100
    """Number of scenes in the folder when done."""
    objects: Path | None = None
    """A folder of URDF objects, instead of the built-in ones."""
    materials: Literal["mixed", "diffuse", "specular", "transparent", "transparent-specular"] = "mixed"
    """What the objects are made of."""
    photos: bool = True
    """Without photos scenes come several times faster and serve the grasp head alone."""
    targets: int = 2
    """Photos from the hemisphere for each scene, besides the inputs: what losses compare with."""
    samples: int = 4
    """Of a photo's pixel, a power of two: twice as many take twice the time, a fifth less noise remains."""
    views: str = "training"
    """Where the cameras stand: training, paper, released, ring6 or hemisphere6."""
    split: Literal["train", "test"] = "train"
    """Objects, panoramas and textures of the two never mix."""
    gripper: str = "panda"
    """The gripper that tries the grasps: a name of a bundled one, or a file."""
    seed: int = 0
    """The same seed gives the same scenes, whatever the number of workers."""
    workers: int | None = None
    """Processes that share the work; by default one per core."""

    def run(self) -> str:
        from neugrasp.simulation.generate import GenerateConfig, generate

        folders = generate(
            GenerateConfig(
                out=self.out,
                scene=self.scene,
                num=self.num,
                objects=self.objects,
                materials=self.materials,
                photos=self.photos,
                targets=self.targets,
                samples=self.samples,
                views=self.views,
                split=self.split,
                gripper=self.gripper,
                seed=self.seed,
                workers=self.workers,
            )
        )
        recipe = [] if self.photos else ["--recipe", "head"]
        then = next_step("train", *recipe, "--data", self.out, "--out", "runs/mine")
        sheet = next_step("datasheet", "--data", self.out, "--out", self.out / "sheet")
        return f"{len(folders)} scenes in {self.out}\n{sheet}\n{then}"
