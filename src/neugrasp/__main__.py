"""Where the program starts: `neugrasp`, and `python -m neugrasp`."""

from __future__ import annotations

import signal
import sys
from _thread import interrupt_main
from threading import Timer, get_ident

AGAIN_AFTER = 0.01
"""Seconds after which an interruption that Python dropped is sent once more."""


def main() -> int:
    """Runs the program; 130 where it is interrupted before it can say so itself.

    What it imports takes its first second; whoever ends it then has made no mistake.
    """
    sys.unraisablehook = _send_interruptions_again
    try:
        from neugrasp import cli

        return cli.main()
    except KeyboardInterrupt:
        return 130


def _send_interruptions_again(dropped: sys.UnraisableHookArgs) -> None:
    """Python drops what is raised in a finaliser or in the callback of a weak reference, of which imports
    make hundreds: Ctrl-C there would do nothing."""
    if not issubclass(dropped.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(dropped)
    elif not sys.is_finalizing():
        again = Timer(AGAIN_AFTER, _interrupt, (get_ident(),))
        again.daemon = True
        again.start()


def _interrupt(thread: int) -> None:
    """As Ctrl-C does, which wakes a thread that waits for something; Windows has no such signal."""
    if hasattr(signal, "pthread_kill"):
        signal.pthread_kill(thread, signal.SIGINT)
    else:
        interrupt_main()


if __name__ == "__main__":
    raise SystemExit(main())
