"""The `neugrasp` program. The only file that prints; heavy parts load when a command needs them."""

from __future__ import annotations

import importlib
import inspect
import logging
import re
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import tyro

import neugrasp
from neugrasp.bench.command import SpeedTest
from neugrasp.data.command import Pack
from neugrasp.demo.command import Demo
from neugrasp.doctor.command import Doctor
from neugrasp.doctor.findings import Verdict
from neugrasp.errors import InputError, NeuGraspError
from neugrasp.evaluation.commands import Compare, Evaluate, Failures, InspectEpisode, OneShot, Table
from neugrasp.exporters.command import Export
from neugrasp.figures.command import Figure
from neugrasp.importers.command import Import, PrintBoard
from neugrasp.operation.command import Calibrate, Capture, Cell, Collect, Run
from neugrasp.report.command import Predict
from neugrasp.ros.command import Ros
from neugrasp.server.command import Serve
from neugrasp.simulation.command import Generate
from neugrasp.terminal import check_command, printable, speak_plainly
from neugrasp.training.command import Train, TrainEvaluator
from neugrasp.viewer.command import Viewer

log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Command:
    """A command: its options as plain data, and what is done with them, which is loaded when it is needed."""

    options: Callable[..., Any]
    runner: str
    """module:function; takes the options and returns what is printed, whole or line by line."""
    settings: str | None = None
    """module:function; makes of the options a configuration whose every field is an option, too."""

    def run(self, name: str, words: Sequence[str]) -> object:
        """Reads the words and runs the command."""
        if self.settings is None:
            options = tyro.cli(self.options, prog=f"neugrasp {name}", args=words)
            self._begin(name, options)
            return _loaded(self.runner)(options)
        options, rest = tyro.cli(self.options, prog=f"neugrasp {name}", args=words, return_unknown_args=True)
        if not {"-h", "--help"} & set(words):
            self._begin(name, options)
        settings = _loaded(self.settings)(options)
        settings = tyro.cli(type(settings), prog=f"neugrasp {name}", args=rest, default=settings)
        return _loaded(self.runner)(options, settings)

    def _begin(self, name: str, options: Any) -> None:
        """Says what now happens, before the libraries load, which takes some seconds itself."""
        log.info("neugrasp %s: %s", name, options.doing)


def _loaded(name: str) -> Callable[..., Any]:
    module, _, function = name.partition(":")
    loaded: Callable[..., Any] = getattr(importlib.import_module(f"neugrasp.{module}"), function)
    return loaded


_positional = tyro.conf.configure(tyro.conf.PositionalRequiredArgs, tyro.conf.OmitArgPrefixes)
COMMANDS: dict[str, Command] = {
    # First what users need first.
    "demo": Command(Demo, "demo.run:run"),
    "doctor": Command(_positional(Doctor), "doctor.run:run"),
    "predict": Command(_positional(Predict), "report.predict:predict"),
    "view": Command(_positional(Viewer), "viewer.run:run"),
    "serve": Command(Serve, "server.run:run"),
    "ros": Command(_positional(Ros), "ros.run:run"),
    "import": Command(_positional(Import), "importers.import_scene:run"),
    "generate": Command(Generate, "simulation.generate:run"),
    "train": Command(Train, "training.trainer:run", "training.recipes:configured"),
    "train-evaluator": Command(TrainEvaluator, "training.evaluator:run"),
    "evaluate": Command(Evaluate, "evaluation.run:run"),
    "run": Command(_positional(Run), "operation.run:run"),
    "cell": Command(_positional(Cell), "operation.check:run"),
    "capture": Command(_positional(Capture), "operation.capture:run"),
    "collect": Command(Collect, "operation.collect:run"),
    "calibrate": Command(_positional(Calibrate), "operation.calibrate:run"),
    "board": Command(PrintBoard, "importers.board_page:run"),
    "export": Command(_positional(Export), "exporters.exporting:run"),
    "pack": Command(Pack, "data.run:run"),
    "one-shot": Command(OneShot, "evaluation.one_shot:run"),
    "compare": Command(_positional(Compare), "evaluation.compare:run"),
    "failures": Command(_positional(Failures), "evaluation.failures:run"),
    "inspect-episode": Command(_positional(InspectEpisode), "evaluation.episode_report:run"),
    "table": Command(_positional(Table), "evaluation.paper_table:run"),
    "figure": Command(_positional(Figure), "figures.run:run"),
    "bench": Command(SpeedTest, "bench.run:run"),
}

RENAMED = {"validate": "one-shot", "story": "inspect-episode"}
"""Commands by their names of before; they are read for one version more."""
GONE = {"results": "python tools/results.py", "datasheet": "python tools/data_sheet.py"}
"""What made the pages of the repository, and what does now; said for one version more."""

FIRST = ("demo", "doctor", "predict", "view", "import", "generate", "train", "evaluate")
"""What users need first; the rest comes below in the help."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one command: 0, or 1 on a bad verdict (the doctor's red, a wrong cell, a weak calibration), 2 on a
    mistake of the user, 130 when interrupted, 70 on a mistake of ours."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    try:
        voice = speak_plainly()
        if words[:1] == ["--version"]:
            print(f"neugrasp {neugrasp.__version__}")
            return 0
        if not words or words[0] in ("-h", "--help"):
            print(_help())
            return 0
        name = _today(words[0])
        check_command(name, COMMANDS)
        report = COMMANDS[name].run(name, words[1:])
        for part in report if isinstance(report, Iterator) else () if report is None else (report,):
            voice.clear()
            print(printable(part), flush=True)
        return report.exit_code if isinstance(report, Verdict) else 0
    except KeyboardInterrupt:
        print("neugrasp: interrupted", file=sys.stderr)
        return 130
    except (NeuGraspError, OSError) as error:
        return _failed(f"{error}")
    except MemoryError:
        return _failed("out of memory")
    except Exception as error:
        # PyTorch has no error of its own for it.
        if "can't allocate memory" in str(error):
            return _failed("out of memory")
        traceback.print_exc()
        return 70


def _today(name: str) -> str:
    """The name that a command has now; whoever uses an older one is told.

    Raises `InputError` where the command left the program.
    """
    if name in GONE:
        raise InputError(f"{name} is no command any more; in a checkout of the repository, run: {GONE[name]}")
    if today := RENAMED.get(name):
        log.warning("neugrasp %s is called %s now; the old name ends with the next version", name, today)
    return today or name


def _help() -> str:
    """The commands, each with the first sentence of what it does."""

    def lines(names: Iterable[str]) -> Iterator[str]:
        for name in names:
            described = inspect.getdoc(COMMANDS[name].options) or ""
            sentence = re.split(r"(?<=[.)])\s", " ".join(described.split()), maxsplit=1)[0]
            yield textwrap.fill(sentence, 88, initial_indent=f"  {name:<16}", subsequent_indent=18 * " ")

    return "\n".join(
        [
            "usage: neugrasp COMMAND [OPTIONS]",
            "",
            "Surfaces and 6-DoF grasps from a few RGB photos of a table.",
            "Start with: neugrasp demo. Of each command: neugrasp COMMAND --help",
            "",
            "commands:",
            *lines(FIRST),
            "",
            "more:",
            *lines(name for name in COMMANDS if name not in FIRST),
        ]
    )


def _failed(reason: str) -> int:
    print(printable(f"neugrasp: error: {reason}", sys.stderr), file=sys.stderr)
    return 2
