"""Signals as a terminal sends them, wherever the tests were started."""

import signal

NUMBERS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


def hear() -> None:
    """In a new process: what a script starts in its background ignores Ctrl-C."""
    for number in NUMBERS:
        signal.signal(number, signal.SIG_DFL)
