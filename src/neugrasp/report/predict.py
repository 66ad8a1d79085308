"""From a scene folder to the files of a prediction, with the doctor's word before."""

from __future__ import annotations

import logging

from neugrasp.data.scene_folder import read_scene
from neugrasp.data.whole_or_nothing import whole_or_nothing
from neugrasp.detection.contract import Detector
from neugrasp.detection.explanation import explain
from neugrasp.detection.files import FILES
from neugrasp.detection.options import DetectorOptions
from neugrasp.detection.registry import PHOTOS, detector_spec
from neugrasp.detection.steering import steered
from neugrasp.doctor.examination import Diagnosis, examine_read
from neugrasp.doctor.findings import Level
from neugrasp.errors import InputError
from neugrasp.observation import Observation
from neugrasp.report.command import Predict
from neugrasp.report.prediction import prediction_report

logger = logging.getLogger(__name__)


def predict(run: Predict) -> str:
    """How many grasps, or why none, and the names of the files written.

    Raises `InputError` where the doctor finds the capture unusable, with what to do.
    """
    with whole_or_nothing(run.out, FILES) as part:
        views = read_scene(run.scene)
        diagnosis = examine_read(views, run.examine)
        _check(run, diagnosis)
        detection = steered(_detector(run).detect(views), run.steering)
        detection.write(part, views)
        if run.report:
            document = prediction_report(run.scene.name, views, detection, diagnosis)
            (part / "report.html").write_text(document, encoding="utf-8")
        names = [name for name in FILES if (part / name).is_file()]
    if detection.grasps:
        first = f"{len(detection.grasps)} grasps, the best with score {detection.grasps[0].score:.2f}"
    else:
        first = f"no grasps: {explain(detection)}"
    return "\n".join([first, *(str(run.out / name) for name in names)])


def _detector(run: Predict) -> Detector[Observation]:
    spec = detector_spec(run.detector)
    if not spec.observes <= PHOTOS:
        needed = " and ".join(sorted(spec.observes - PHOTOS))
        raise InputError(f"--detector {run.detector}: needs {needed}, and a scene folder holds photos")
    return spec.load(
        DetectorOptions(
            weights=run.weights,
            gripper=run.gripper,
            threshold=run.threshold,
            hand_check=run.hand_check,
            device=run.device,
            precision=run.precision,
        )
    )


def _check(run: Predict, diagnosis: Diagnosis) -> None:
    """Warns of what is yellow, or was not measured and matters; raises `InputError` on red unless forced."""
    red = diagnosis.lines(Level.RED)
    if red and not run.force:
        hint = f"`neugrasp doctor {run.scene} --report FILE.html` shows it, --force predicts all the same"
        raise InputError("\n".join([f"{run.scene}: the doctor says red; {hint}", *red]))
    for finding in diagnosis.findings:
        if finding.problem is not None:
            logger.warning("%s", finding.line())
