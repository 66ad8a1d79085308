"""From a scene folder to the files of a prediction, with the doctor's word before."""

from __future__ import annotations

import logging

from neugrasp.client import Client, read_token
from neugrasp.data.scene_folder import photo_files, read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.contract import Detection
from neugrasp.detection.explanation import explain
from neugrasp.detection.files import FILES
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import photo_detector
from neugrasp.detection.steering import check_mask, steered
from neugrasp.doctor.examination import Diagnosis, examine_read
from neugrasp.doctor.findings import Level
from neugrasp.errors import InputError
from neugrasp.observation import Views
from neugrasp.output import check_file
from neugrasp.progress import reached
from neugrasp.report.command import Predict
from neugrasp.report.prediction import prediction_report
from neugrasp.terminal import next_step

logger = logging.getLogger(__name__)
STEPS = 5
"""Reading, examining, loading the weights, detecting, writing."""
OF_THE_SERVER = (
    "detector",
    "weights",
    "gripper",
    "threshold",
    "hand_check",
    "evaluator",
    "device",
    "precision",
)
"""Options that a server was started with."""


def predict(run: Predict) -> str:
    """How many grasps, or why none, the doctor's word, the files written, and what to do next.

    Raises `InputError` where the doctor finds the capture unusable, with what to do.
    """
    with whole_or_nothing(run.out, FILES) as part:
        reached("steps", 0, STEPS)
        views = read_scene(run.scene)
        for name in FILES:
            check_file(run.out / name, photo_files(run.scene))
        check_mask(run.steering, views)
        reached("steps", 1, STEPS)
        diagnosis = examine_read(views, run.examine)
        _check(run, diagnosis)
        reached("steps", 2, STEPS)
        detection = _detected(run, views)
        reached("steps", 4, STEPS)
        detection.write(part, views)
        if run.report:
            document = prediction_report(run.scene.name, views, detection, diagnosis)
            (part / "report.html").write_text(document, encoding="utf-8")
        names = [name for name in FILES if (part / name).is_file()]
        reached("steps", STEPS, STEPS)
    if detection.grasps:
        first = f"{len(detection.grasps)} grasps, the best with score {detection.grasps[0].score:.2f}"
    else:
        first = f"no grasps: {explain(detection)}"
    look = "the doctor" if run.examine else "the doctor's quick look"
    files = [str(run.out / name) for name in names]
    then = [next_step("view", run.out)] if detection.tsdf is not None else []
    if detection.grasps:
        then.append(next_step("export", run.out))
    return "\n".join([first, f"{look}: {diagnosis.verdict}", *files, *then])


def _detected(run: Predict, views: Views) -> Detection:
    """By this machine, or by the server that was named."""
    if run.server is None:
        detector = photo_detector(run.detector, "a scene folder").load(DetectorOptions.of(run))
        reached("steps", 3, STEPS)
        return steered(detector.detect(views), run.steering, views)
    if changed := [name for name in OF_THE_SERVER if getattr(run, name) != getattr(Predict, name)]:
        words = ", ".join(f"--{name.replace('_', '-')}" for name in changed)
        raise InputError(
            f"{words}: what the server at {run.server} predicts with was said when it was started"
        )
    with Client(run.server, read_token(run.token_file)) as client:
        reached("steps", 3, STEPS)
        # The doctor was asked here.
        return client.ask(run.scene, run.steering, force=True).detection


def _check(run: Predict, diagnosis: Diagnosis) -> None:
    """Warns of what is yellow, or was not measured and matters; raises `InputError` on red unless forced."""
    red = diagnosis.lines(Level.RED)
    if red and not run.force:
        hint = f"`neugrasp doctor {run.scene} --report FILE.html` shows it, --force predicts all the same"
        raise InputError("\n".join([f"{run.scene}: the doctor says red; {hint}", *red]))
    for finding in diagnosis.findings:
        if finding.problem is not None:
            logger.warning("%s", finding.line())
