"""The command that measures speed."""

from __future__ import annotations

from neugrasp.bench.command import SpeedTest
from neugrasp.bench.detectors import time_detectors, timings_report, timings_table
from neugrasp.bench.measure import measure
from neugrasp.bench.report import summary, table, write_json
from neugrasp.errors import InputError
from neugrasp.model.compute import Compute
from neugrasp.output import check_file
from neugrasp.terminal import next_step


def run(config: SpeedTest) -> str:
    """`neugrasp bench`: the table."""
    _check(config)
    if config.detectors:
        timed = time_detectors(config)
        found, lines = timings_report(config, *timed), [timings_table(*timed)]
    else:
        found = summary(measure(config))
        lines = [table(found)]
    if config.json is not None:
        write_json(config.json, found)
        lines += [f"\n{config.json}", "next: docs/bench.md says what the columns mean"]
    else:
        words = config.command().split()[1:]
        lines.append("\n" + next_step(*words, "--json", "speed.json", why="to keep the figures"))
    return "\n".join(lines)


def _check(config: SpeedTest) -> None:
    if not 1 <= config.views <= 8:
        raise InputError(f"--views {config.views}: a scene has 1 to 8 views")
    if config.json is not None:
        check_file(config.json)
    for option, value in (("--rounds", config.rounds), ("--threads", config.threads)):
        if value is not None and value < 1:
            raise InputError(f"{option} {value}: must be at least 1")
    if not config.detectors and (config.only or config.weights):
        raise InputError("--only and --weights are for --detectors")
    Compute.of(config.device)
