"""The doctor's command: examine, tell, report, mend."""

from __future__ import annotations

from neugrasp.doctor.command import Doctor
from neugrasp.doctor.examination import examine_folder
from neugrasp.doctor.findings import Level, Verdict
from neugrasp.doctor.fix import write_fixed
from neugrasp.doctor.report import report
from neugrasp.errors import InputError
from neugrasp.output import whole_file
from neugrasp.terminal import next_step


def run(config: Doctor) -> Verdict:
    """`neugrasp doctor`: the findings as text."""
    if config.report is None:
        diagnosis = examine_folder(config.scene)
    else:
        if config.report.suffix.lower() not in (".html", ".htm"):
            raise InputError(f"--report {config.report}: give a name that ends with .html")
        with whole_file(config.report, inputs=[config.scene]) as part:
            diagnosis = examine_folder(config.scene)
            part.write_text(report(diagnosis, config.scene.name), encoding="utf-8")
    lines = [*diagnosis.lines(), f"\n{config.scene}: {diagnosis.verdict}"]
    if config.report is not None:
        lines.append(str(config.report))
    good = config.scene if diagnosis.level != Level.RED else None
    if config.fix is not None:
        write_fixed(diagnosis, config.scene, config.fix)
        again = examine_folder(config.fix)
        lines += [f"{config.fix}: {again.verdict}", *again.lines(Level.YELLOW)]
        good = config.fix if again.level != Level.RED else good
    if good is not None:
        lines.append(next_step("predict", good, "--out", f"outputs/{good.resolve().name}"))
    elif diagnosis.is_mended and config.fix is None:
        lines.append(next_step("doctor", config.scene, "--fix", f"{config.scene.resolve().name}_fixed"))
    else:
        lines.append(next_step("doctor", config.scene, why="when what is red is mended"))
    return Verdict("\n".join(lines), 1 if diagnosis.level == Level.RED else 0)
