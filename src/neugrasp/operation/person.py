"""A person at a terminal, who is told what to do and asked when it is done."""

from __future__ import annotations

import sys
from typing import TextIO

from neugrasp.errors import InputError
from neugrasp.robot.errors import Stopped

QUIT = ("q", "quit")


class Person:
    """Who sits at the terminal."""

    def __init__(self, alone: str, answers: TextIO | None = None, told: TextIO | None = None):
        """Raises `InputError`, saying what `alone` says, where nobody sits there."""
        self._answers, self._told = answers or sys.stdin, told or sys.stderr
        if not (self._answers.isatty() and self._told.isatty()):
            raise InputError(alone)

    def asked(self, words: str, ended: str = "a person ended it; the same command goes on") -> str:
        """The answer to some words, in small letters. Raises `Stopped`, saying what `ended` says, on q and
        where nobody answers."""
        self._told.write(f"{words} ")
        self._told.flush()
        answer = self._answers.readline()
        word = answer.strip().lower()
        if not answer or word in QUIT:
            raise Stopped(ended)
        return word

    def told(self, words: str) -> None:
        """Says something."""
        self._told.write(f"{words}\n")
