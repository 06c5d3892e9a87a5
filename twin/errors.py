"""Our exceptions: the constructor writes the sentence (what, which value, what would do).

Every error a user can cause is a `TwinError`; the command line prints it without a traceback.
"""

import difflib
from collections.abc import Iterable
from pathlib import Path
from typing import Any


class TwinError(Exception):
    """Base of everything we raise on purpose."""

    outcome: Any = None
    """How far a run had come that this ended (`twin.loop.Outcome`); None: it was no run."""
    run: Any = None
    """What there is of that run (`twin.flight.Run`), where `twin.fly` flew it."""

    def __reduce__(self) -> tuple[Any, ...]:
        # their constructors take other arguments than their sentence, and processes send them
        return _rebuilt, (type(self), self.args, self.__dict__)


def _rebuilt(
    kind: type[TwinError], args: tuple[object, ...], facts: dict[str, object]
) -> TwinError:
    error = kind.__new__(kind)
    error.args = args
    error.__dict__.update(facts)
    return error


class UnknownName(TwinError, LookupError):
    """A name that is not among those known; says which one was probably meant."""

    def __init__(self, kind: str, name: str, known: Iterable[str]) -> None:
        names = sorted(known)
        close = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
        if close:
            hint = "did you mean " + ", ".join(repr(match) for match in close) + "?"
        else:
            hint = "known: " + (", ".join(names) or "none")
        super().__init__(f"no {kind} named {name!r} ({hint})")
        self.kind = kind
        self.name = name
        self.hint = hint
        """What was probably meant, else what is known."""


class FileError(TwinError, ValueError):
    """Something in a user's file is wrong: where it stands, what it is, what would do."""

    def __init__(
        self, path: str | Path, problem: str, remedy: str, *, line: int | None = None
    ) -> None:
        where = f"{path}:{line}" if line is not None else f"{path}"
        super().__init__(f"{where}: {problem}; {remedy}")
        self.path = Path(path)
        self.line = line


class PlatformError(FileError):
    """A platform folder that contradicts itself or physics."""


class LogError(FileError):
    """A measured log that cannot be read as it stands."""


class CampaignError(FileError):
    """A campaign's specification that cannot be flown, or a folder that holds something else."""


class RecordingError(FileError):
    """A recording that cannot be written or read."""

    machines: tuple[str, ...] = ()
    """Of a recording of several, none of which was chosen, their names."""


class ControllerError(TwinError, ValueError):
    """A control law that does not keep the contract of `twin.controller`."""


class CommandError(TwinError, ValueError):
    """A command that the machine cannot take: unknown channel, wrong shape, not finite."""


class UsageError(TwinError, ValueError):
    """A call or a command line whose parts do not fit together; exit code 2."""


class DeviceError(TwinError, OSError):
    """A device that does not answer, refuses, or answers otherwise than it should."""

    def __init__(self, device: str, problem: str, remedy: str) -> None:
        super().__init__(f"{device}: {problem}; {remedy}")
        self.device = device


class SafetyError(TwinError, RuntimeError):
    """What the guard of a machine refuses."""

    def __init__(self, problem: str, remedy: str) -> None:
        super().__init__(f"{problem}; {remedy}")
