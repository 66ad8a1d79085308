"""One of the figures, from a model and photos."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from neugrasp.data.scene_folder import photo_files
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.registry import load_detector
from neugrasp.errors import InputError
from neugrasp.figures.command import DEFAULT_SCENE, Figure
from neugrasp.figures.features import features_figure
from neugrasp.figures.figure_inputs import open_figure_input
from neugrasp.figures.priors import priors_figure
from neugrasp.figures.trajectory import trajectory_figure
from neugrasp.observation import Image
from neugrasp.output import whole_file
from neugrasp.pictures import write_picture
from neugrasp.terminal import next_step


def run(config: Figure) -> str:
    """`neugrasp figure`: the name of the picture, and what to do next."""
    if config.without is not None and config.which != "priors":
        raise InputError(f"--without is for the figure priors; {config.which} shows one model")
    out = config.out or Path("outputs/figures") / f"{config.which}.png"
    if out.suffix.lower() != ".png":
        raise InputError(f"--out {out}: figures are PNG files; give a name that ends with .png")
    with whole_file(out, inputs=photo_files(config.scene)) as part:
        write_picture(part, _drawn(config))
    others = {"features": "priors", "priors": "trajectory", "trajectory": "features"}
    scene = [] if config.scene == DEFAULT_SCENE else ["--scene", config.scene]
    return f"{out}\n{next_step('figure', others[config.which], *scene)}"


def _drawn(config: Figure) -> Image:
    source = open_figure_input(config.scene, config.view)
    if config.which == "trajectory":
        finds = load_detector(
            weights=config.weights, gripper=config.gripper, device=config.device, precision=config.precision
        )
        found = finds.detect(source.views)
        return trajectory_figure(source, found, found.gripper)
    load = partial(
        NeuGraspDetector.load, gripper=config.gripper, device=config.device, precision=config.precision
    )
    detector = load(config.weights)
    if config.which == "features":
        return features_figure(source, detector.model, np.random.default_rng(config.seed))
    return priors_figure(source, detector, None if config.without is None else load(config.without))
