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
from neugrasp.progress import reached
from neugrasp.report.prediction import prediction_report
from neugrasp.terminal import next_step

logger = logging.getLogger(__name__)
STEPS = 5
"""Reading, examining, loading the weights, detecting, writing."""


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
    steering: Steering = field(default_factory=Steering)
    """Which grasps are wanted."""
    is_examined: bool = False
    """Whether the doctor looks at everything; otherwise at what costs little and decides."""
    is_forced: bool = False
    """Whether to predict even where the doctor says red."""


def predict(run: PredictRun) -> str:
    """How many grasps, or why none, the doctor's word, the files written, and what to do next.

    Raises `InputError` where the doctor finds the capture unusable, with what to do.
    """
    with whole_or_nothing(run.out, FILES) as part:
        reached("steps", 0, STEPS)
        views = read_scene(run.scene)
        run.steering.check(views)
        reached("steps", 1, STEPS)
        diagnosis = examine_read(views, run.is_examined)
        _check(run, diagnosis)
        reached("steps", 2, STEPS)
        detector = NeuGraspDetector.load(
            run.weights, run.gripper, threshold=run.threshold, hand_check=run.hand_check
        )
        reached("steps", 3, STEPS)
        detection = run.steering.applied(detector.detect(views), views.workspace, views)
        reached("steps", 4, STEPS)
        write_prediction(part, views, detection, detector.gripper)
        if run.with_report:
            document = prediction_report(run.scene.name, views, detection, detector.gripper, diagnosis)
            (part / "report.html").write_text(document, encoding="utf-8")
        names = [name for name in FILES if (part / name).is_file()]
        reached("steps", STEPS, STEPS)
    if detection.grasps:
        first = f"{len(detection.grasps)} grasps, the best with score {detection.grasps[0].score:.2f}"
    else:
        first = f"no grasps: {explain(detection)}"
    look = "the doctor" if run.is_examined else "the doctor's quick look"
    files = [str(run.out / name) for name in names]
    then = [next_step("view", run.out)]
    if detection.grasps:
        then.append(next_step("export", run.out))
    return "\n".join([first, f"{look}: {diagnosis.verdict}", *files, *then])


def _check(run: PredictRun, diagnosis: Diagnosis) -> None:
    """Warns of what is yellow, or was not measured and matters; raises `InputError` on red unless forced."""
    red = diagnosis.lines(Level.RED)
    if red and not run.is_forced:
        hint = f"`neugrasp doctor {run.scene} --report FILE.html` shows it, --force predicts all the same"
        raise InputError("\n".join([f"{run.scene}: the doctor says red; {hint}", *red]))
    for finding in diagnosis.findings:
        if finding.problem is not None:
            logger.warning("%s", finding.line())
