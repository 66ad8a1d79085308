"""`neugrasp doctor` as plain data; heavy parts load when it is run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from neugrasp.doctor.findings import Verdict
from neugrasp.errors import InputError
from neugrasp.output import whole_file
from neugrasp.terminal import next_step


@dataclass(frozen=True)
class Doctor:
    """Checks a capture before anything is predicted: files, conventions, units, light, focus, what is seen.

    One line for each item with the measured value and what to do: green, yellow (worse grasps), red (grasps
    fail) or grey (could not be measured). Ends with 1 on red.
    """

    doing: ClassVar[str] = "looking at the photos, some seconds"

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
        good = self.scene if diagnosis.level != Level.RED else None
        if self.fix is not None:
            write_fixed(diagnosis, self.scene, self.fix)
            again = examine_folder(self.fix)
            lines += [f"{self.fix}: {again.verdict}", *again.lines(Level.YELLOW)]
            good = self.fix if again.level != Level.RED else good
        if good is not None:
            lines.append(next_step("predict", good, "--out", f"outputs/{good.resolve().name}"))
        elif diagnosis.is_mended and self.fix is None:
            lines.append(next_step("doctor", self.scene, "--fix", f"{self.scene.resolve().name}_fixed"))
        else:
            lines.append(next_step("doctor", self.scene, why="when what is red is mended"))
        return Verdict("\n".join(lines), 1 if diagnosis.level == Level.RED else 0)
