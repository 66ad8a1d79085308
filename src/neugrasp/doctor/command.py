"""`neugrasp doctor` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from neugrasp.doctor.findings import Verdict
from neugrasp.errors import InputError
from neugrasp.output import whole_file


@dataclass(frozen=True)
class Doctor:
    """Checks a capture before anything is predicted: files, conventions, units, light, focus, what is seen.

    One line for each item with the measured value and what to do: green, yellow (worse grasps), red (grasps
    fail) or grey (could not be measured). Ends with 1 on red.
    """

    scene: Path
    """A scene folder: scene.json, images/, backgrounds/."""
    report: Path | None = None
    """An HTML file to write, with the cube and the table drawn into every photo."""
    fix: Path | None = None
    """A new folder for a corrected copy, where the cause is certain."""

    def run(self) -> Verdict:
        """The findings as text."""
        from neugrasp.doctor.examination import examine_folder
        from neugrasp.doctor.findings import Level
        from neugrasp.doctor.fix import write_fixed
        from neugrasp.doctor.report import report

        if self.report is None:
            diagnosis = examine_folder(self.scene)
        else:
            if self.report.suffix.lower() not in (".html", ".htm"):
                raise InputError(f"--report {self.report}: give a name that ends with .html")
            with whole_file(self.report, inputs=[self.scene]) as part:
                diagnosis = examine_folder(self.scene)
                part.write_text(report(diagnosis, self.scene.name), encoding="utf-8")
        lines = [*diagnosis.lines(), f"\n{self.scene}: {diagnosis.verdict}"]
        if self.report is not None:
            lines.append(str(self.report))
        if self.fix is not None:
            write_fixed(diagnosis, self.scene, self.fix)
            again = examine_folder(self.fix)
            lines += [f"{self.fix}: {again.verdict}", *again.lines(Level.YELLOW)]
        return Verdict("\n".join(lines), 1 if diagnosis.level == Level.RED else 0)
