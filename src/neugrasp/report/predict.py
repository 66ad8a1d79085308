"""From a scene folder to the files of a prediction, with the doctor's word before."""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from pathlib import Path

from neugrasp.data.scene_folder import read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.detector import NeuGraspDetector
from neugrasp.detection.explanation import explain
from neugrasp.detection.steering import Steering
from neugrasp.doctor.examination import Diagnosis, examine_read
from neugrasp.doctor.findings import Level
from neugrasp.errors import InputError
from neugrasp.export import FILES, write_prediction
from neugrasp.report.prediction import prediction_report

logger = logging.getLogger(__name__)


@dataclass(frozen=True, kw_only=True)
class PredictRun:
    """What is predicted from, where to, and how."""

    scene: Path
    """A scene folder."""
    out: Path
    """Where the files are written: all of them or none."""
    weights: str = "neugrasp"
    """A name of bundled weights, or a file."""
    gripper: str = "panda"
    """A name of a bundled gripper, or a file."""
    threshold: float | None = None
    """Score from which grasps are kept; by default what the weights were judged with."""
    with_report: bool = False
    """Whether report.html is written, too."""
    hand_check: bool = True
    """Whether grasps go as deep as the surface lets the hand, and are dropped where it would meet it or close
    on nothing."""
    evaluator: str | None = None
    """A bundled evaluator of grasps by name, or a file, that judges instead of the head and its rules."""
    steering: Steering = field(default_factory=Steering)
    """Which grasps are wanted."""
    is_examined: bool = False
    """Whether the doctor looks at everything; otherwise at what costs little and decides."""
    is_forced: bool = False
    """Whether to predict even where the doctor says red."""


def predict(run: PredictRun) -> str:
    """How many grasps, or why none, and the names of the files written.

    Raises `InputError` where the doctor finds the capture unusable, with what to do.
    """
    with whole_or_nothing(run.out, FILES) as part:
        views = read_scene(run.scene)
        diagnosis = examine_read(views, run.is_examined)
        _check(run, diagnosis)
        detector = NeuGraspDetector.load(
            run.weights,
            run.gripper,
            threshold=run.threshold,
            hand_check=run.hand_check,
            evaluator=run.evaluator,
        )
        detection = run.steering.applied(detector.detect(views), views.workspace)
        write_prediction(part, views, detection, detector.gripper)
        if run.with_report:
            document = prediction_report(run.scene.name, views, detection, detector.gripper, diagnosis)
            (part / "report.html").write_text(document, encoding="utf-8")
        names = [name for name in FILES if (part / name).is_file()]
    if detection.grasps:
        first = f"{len(detection.grasps)} grasps, the best with score {detection.grasps[0].score:.2f}"
    else:
        first = f"no grasps: {explain(detection)}"
    return "\n".join([first, *(str(run.out / name) for name in names)])


def _check(run: PredictRun, diagnosis: Diagnosis) -> None:
    """Warns of what is yellow, or was not measured and matters; raises `InputError` on red unless forced."""
    red = diagnosis.lines(Level.RED)
    if red and not run.is_forced:
        hint = f"`neugrasp doctor {run.scene} --report FILE.html` shows it, --force predicts all the same"
        raise InputError("\n".join([f"{run.scene}: the doctor says red; {hint}", *red]))
    for finding in diagnosis.findings:
        if finding.problem is not None:
            logger.warning("%s", finding.line())
