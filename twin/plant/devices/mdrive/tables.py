"""What the MCode language of IMS (Schneider) MDrives is made of, as data.

From the "MCode Programming and Software Reference", sections 4 and 5 and the list of error codes.
"""

from dataclasses import dataclass
from enum import Enum

ACKNOWLEDGE, REFUSE = 0x06, 0x15
END = b"\n"
"""Ends a command in party mode and with checksums."""
LONGEST = 64
"""Characters that a drive's receive buffer holds, spaces included."""


class Effect(Enum):
    """What an error of a drive means for whoever moves it."""

    line = "a command was not understood, and is sent again where it matters"
    refused = "the command was refused"
    limit = "the stage is at a limit switch, and may only go back"
    lost = "the position is lost"
    stopped = "the drive has stopped"
    warning = "worth knowing"


@dataclass(frozen=True)
class ErrorCode:
    """One entry of the list."""

    sentence: str
    effect: Effect


ERRORS = {
    20: ErrorCode("unknown variable, or its receive buffer ran over", Effect.line),
    21: ErrorCode("value out of range", Effect.refused),
    22: ErrorCode("the initial speed VI is not below the maximum VM", Effect.refused),
    23: ErrorCode("the maximum speed VM is not above the initial VI", Effect.refused),
    24: ErrorCode("illegal data", Effect.line),
    25: ErrorCode("the variable can only be read", Effect.refused),
    30: ErrorCode("unknown label", Effect.line),
    34: ErrorCode("a variable cannot be executed", Effect.line),
    35: ErrorCode("the variable cannot be printed", Effect.line),
    37: ErrorCode("not in this drive", Effect.refused),
    40: ErrorCode("no program runs", Effect.warning),
    61: ErrorCode("baud rate out of range", Effect.refused),
    62: ErrorCode("settings were not loaded", Effect.refused),
    63: ErrorCode("characters came faster than it could take", Effect.line),
    70: ErrorCode("its memory has a wrong checksum", Effect.stopped),
    71: ErrorCode("it is getting too hot", Effect.warning),
    72: ErrorCode("it is too hot and has switched the motor off", Effect.lost),
    73: ErrorCode("it cannot save while it moves", Effect.refused),
    74: ErrorCode("it cannot load settings while it moves", Effect.refused),
    80: ErrorCode("no home switch is set up", Effect.refused),
    81: ErrorCode("no home switch is set up", Effect.refused),
    82: ErrorCode("it met both limit switches and no home switch", Effect.stopped),
    83: ErrorCode("it is at the limit switch towards plus", Effect.limit),
    84: ErrorCode("it is at the limit switch towards minus", Effect.limit),
    85: ErrorCode("it cannot move while it seeks home", Effect.refused),
    86: ErrorCode("the motor has stalled", Effect.lost),
    91: ErrorCode("its stop input is active", Effect.stopped),
    92: ErrorCode("its position error is too large", Effect.lost),
    93: ErrorCode("it cannot move while it corrects its position", Effect.refused),
}
"""Code in ER -> what it says, and what follows."""


def error_named(code: int) -> ErrorCode:
    """The entry of that code; an unknown one stops the drive."""
    return ERRORS.get(code, ErrorCode("an error that is not in the list", Effect.stopped))


@dataclass(frozen=True)
class Register:
    """A variable that a host may set."""

    low: int
    high: int


SETTABLE = {
    "VI": Register(1, 5_000_000),
    "VM": Register(1, 5_000_000),
    "A": Register(91, 1_525_878_997),
    "D": Register(91, 1_525_878_997),
    "RC": Register(1, 100),
    "HC": Register(0, 100),
    "HT": Register(0, 65535),
    "MT": Register(0, 65535),
    "LM": Register(1, 6),
}
"""Variables that the settings of a drive write, and their ranges."""

HOME_INPUT, PLUS_INPUT, MINUS_INPUT = 1, 2, 3
"""Kinds of an input: home switch, limit switch towards plus, and towards minus."""
