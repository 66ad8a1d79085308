"""How far a work is: a bar below the messages on a terminal, and nothing anywhere else."""

from __future__ import annotations

import io
import logging

import pytest

from neugrasp.progress import counted, log, reached
from neugrasp.terminal import TerminalLog, next_step


class Terminal(io.StringIO):
    """A stream that says that it is a terminal."""

    def isatty(self) -> bool:
        return True

    def lines(self) -> list[str]:
        """What is to be seen in the end: a carriage return writes over what stood there."""
        shown = []
        for line in self.getvalue().split("\n"):
            seen = ""
            for part in line.split("\r"):
                seen = part + seen[len(part) :]
            shown.append(seen.rstrip())
        return shown


@pytest.fixture
def terminal() -> Terminal:
    return Terminal()


@pytest.fixture
def handler(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> TerminalLog:
    handler = TerminalLog(terminal)
    monkeypatch.setattr(log, "handlers", [handler])
    monkeypatch.setattr(log, "propagate", False)
    log.setLevel(logging.DEBUG)
    return handler


def test_a_bar_moves_and_goes_at_the_end(terminal: Terminal, handler: TerminalLog):
    seen = []
    for _ in counted(["a", "b", "c"], "scenes"):
        seen.append(terminal.lines()[-1])
    assert seen[0].endswith("] 0 of 3 scenes")
    assert "] 2 of 3 scenes, 0 s left" in seen[2]
    assert seen[0].count("#") < seen[1].count("#") < seen[2].count("#")
    assert terminal.lines() == [""]


def test_messages_stand_above_the_bar(terminal: Terminal, handler: TerminalLog):
    reached("scenes", 1, 2)
    log.info("table_0: done")
    reached("scenes", 1, 2)
    assert terminal.lines()[0] == "table_0: done"
    assert "1 of 2 scenes" in terminal.lines()[1]
    handler.clear()
    assert terminal.lines() == ["table_0: done", ""]


def test_a_run_that_goes_on_does_not_count_what_it_found_as_fast(
    terminal: Terminal, handler: TerminalLog, monkeypatch: pytest.MonkeyPatch
):
    clock = iter([0.0, 10.0])
    monkeypatch.setattr("neugrasp.terminal.time.monotonic", lambda: next(clock))
    reached("scenes", 90, 100)
    reached("scenes", 91, 100)
    assert terminal.lines()[-1].endswith("91 of 100 scenes, 2 min left")


def test_a_file_gets_no_bar(monkeypatch: pytest.MonkeyPatch):
    stream = io.StringIO()
    monkeypatch.setattr(log, "handlers", [TerminalLog(stream)])
    monkeypatch.setattr(log, "propagate", False)
    assert list(counted((x for x in "ab"), "scenes", total=2)) == ["a", "b"]
    assert stream.getvalue() == ""


def test_the_next_step_can_be_typed():
    assert next_step("view", "my scene", why="to turn it") == "next: neugrasp view 'my scene'  # to turn it"
