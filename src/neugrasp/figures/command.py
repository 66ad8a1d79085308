"""`neugrasp figure` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal

from neugrasp.errors import InputError
from neugrasp.output import photos_in, whole_file
from neugrasp.terminal import next_step

if TYPE_CHECKING:
    from neugrasp.views import Image

DEFAULT_SCENE = "packed_transparent"


@dataclass(frozen=True)
class Figure:
    """Draws a figure of the paper from a model and photos of your own (docs/figures.md).

    features: what the network sees in a photo, before and after it heeds the background (Fig. 4).
    priors: surface and grasps with and without photos of the empty table (Fig. 5).
    trajectory: from where the photos are taken, and the way of the hand to the best grasp and back.
    """

    doing: ClassVar[str] = "drawing, up to a minute"

    which: Literal["features", "priors", "trajectory"]
    """The figure to draw."""
    out: Path | None = None
    """The PNG file to write; by default outputs/figures/WHICH.png."""
    scene: str = DEFAULT_SCENE
    """A scene folder, or the name of a bundled scene."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    without: str | None = None
    """For priors: weights of a model trained without backgrounds. By default, the figure shows what the model
    of --weights makes of photos whose empty table was taken away."""
    gripper: str = "panda"
    """The gripper to draw: a name of a bundled one, or a file."""
    view: int = 0
    """The photo to draw, from 0."""
    seed: int = 0
    """For features: chooses the pixels that are embedded."""

    def run(self) -> str:
        """The name of the picture, and what to do next."""
        from neugrasp.export import write_picture

        if self.without is not None and self.which != "priors":
            raise InputError(f"--without is for the figure priors; {self.which} shows one model")
        out = self.out or Path("outputs/figures") / f"{self.which}.png"
        if out.suffix.lower() != ".png":
            raise InputError(f"--out {out}: figures are PNG files; give a name that ends with .png")
        with whole_file(out, inputs=photos_in(Path(self.scene))) as part:
            write_picture(part, self._draw())
        others = {"features": "priors", "priors": "trajectory", "trajectory": "features"}
        scene = [] if self.scene == DEFAULT_SCENE else ["--scene", self.scene]
        return f"{out}\n{next_step('figure', others[self.which], *scene)}"

    def _draw(self) -> Image:
        import numpy as np

        from neugrasp.detection.detector import NeuGraspDetector
        from neugrasp.figures.subject import open_subject

        subject = open_subject(self.scene, self.view)
        detector = NeuGraspDetector.load(self.weights, self.gripper)
        if self.which == "features":
            from neugrasp.figures.features import features_figure

            return features_figure(subject, detector.model, np.random.default_rng(self.seed))
        if self.which == "priors":
            from neugrasp.figures.priors import priors_figure

            other = None if self.without is None else NeuGraspDetector.load(self.without, self.gripper)
            return priors_figure(subject, detector, other)
        from neugrasp.figures.trajectory import trajectory_figure

        return trajectory_figure(subject, detector.detect(subject.views), detector.gripper)
