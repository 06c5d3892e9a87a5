"""How a drive is found on the line, set up and homed. These may take seconds: nothing flies yet."""

import time

from twin.errors import DeviceError
from twin.plant.devices.mdrive.line import Line, Mode
from twin.plant.devices.mdrive.settings import DriveSettings
from twin.plant.devices.mdrive.tables import error_named
from twin.stop import check, requested

CONFIGURED, HOMED = 31001, 31002
"""What the mark register holds: set up, or set up and homed, since the drive got its power."""
_LOOKS = 3
"""How often a drive is asked for its error where the question itself is lost."""
_SLOW = 1.0
"""How long a drive may take to come to rest [s], beyond its ramp."""


def recognise(line: Line, address: str) -> Mode | None:
    """How the drive talks, asked in every way; None: it does not answer.

    Without a checksum first: a drive that wants one refuses, and does nothing.
    """
    line.activate()
    for checked in (False, True):
        mode = Mode(checked=checked)
        if line.ask(address, ["EM"], mode, tries=2) is not None:
            return mode
    return None


def set_up(
    name: str, line: Line, drive: DriveSettings, mark: str, wanted: Mode
) -> tuple[Mode, int, bool, tuple[int, ...]]:
    """Write the settings and read them back.

    Returns:
        How it talks from now on, P, whether it is still homed, and the errors that were pending.

    Raises:
        DeviceError: no answer, or another value than the one written.
    """
    mode = recognise(line, drive.address)
    who = f"{name}: drive {drive.address}"
    if mode is None:
        raise DeviceError(who, "does not answer", "check power, name (DN), party mode and baud")
    line.tell(drive.address, "SL 0", mode)
    line.tell(drive.address, f"EM={wanted.echo}", mode)
    line.tell(drive.address, f"CK={int(wanted.checked)}", mode)
    mode = wanted
    _expect(who, line, drive.address, mode, {"EM": wanted.echo, "CK": int(wanted.checked)})
    wait_for_rest(who, line, drive, mode)
    _expect(who, line, drive.address, mode, {"MS": drive.microsteps})
    found = _ask(who, line, drive.address, mode, [mark])[0]
    # now: a write that fails puts its own code in the place of a stall's
    before = pending_error(who, line, drive.address, mark, mode)
    for _ in range(2):
        # twice: VI and VM may be written in one order only, which depends on what they were
        for register, value in drive.registers().items():
            line.tell(drive.address, f"{register}={value}", mode)
    for number, (kind, level) in drive.inputs.items():
        line.tell(drive.address, f"S{number}={kind},{level}", mode)
    line.tell(drive.address, "DE=1", mode)
    _expect(who, line, drive.address, mode, {**drive.registers(), "DE": 1})
    for number, source in drive.inputs.items():
        answer = _ask(who, line, drive.address, mode, [f"S{number}"])
        if answer[:2] != source:
            raise _otherwise(who, f"S{number}", answer, source)
    after = pending_error(who, line, drive.address, mark, mode)
    # two of the writes may have failed on purpose
    errors = tuple(code for code in (before, after) if code not in (0, 22, 23, 35))
    homed = found == HOMED
    line.tell(drive.address, f"{mark}={HOMED if homed else CONFIGURED}", mode)
    _expect(who, line, drive.address, mode, {mark: HOMED if homed else CONFIGURED})
    position = _ask(who, line, drive.address, mode, ["P"])[0]
    return mode, position, homed, errors


def pending_error(who: str, line: Line, address: str, mark: str, mode: Mode) -> int:
    """The error code that waits in a drive; 0: none.

    Raises:
        DeviceError: no answer, or the code was read, which clears it, and lost on the line.
    """
    for _ in range(_LOOKS):
        if not _ask(who, line, address, mode, ["EF"])[0]:
            return 0
        answer = line.ask(address, ["ER"], mode, tries=1)
        if answer is not None:
            return answer[0]
        if not _ask(who, line, address, mode, ["EF"])[0]:
            break
    line.tell(address, f"{mark}={CONFIGURED}", mode)
    problem = "had an error whose code was lost on the line, perhaps a stall"
    raise DeviceError(who, problem, "capture the table, configure it anew and home it")


def seek_home(name: str, line: Line, drive: DriveSettings, mark: str, mode: Mode) -> int:
    """Run to the home switch, count from there; P afterwards.

    Raises:
        DeviceError: no home switch, an error of the drive, or not within the time.
    """
    who = f"{name}: drive {drive.address}"
    if not drive.has_home:
        raise DeviceError(who, "has no home switch", "set up an input of kind 1")
    address, slow = drive.address, drive.rate(drive.home_speed)
    try:
        line.tell(address, f"VM={slow}", mode)
        _expect(who, line, address, mode, {"VM": slow})
        _ask(who, line, address, mode, ["ER"])
        line.tell(address, f"HM {drive.home_method}", mode)
        wait_for_rest(who, line, drive, mode, _longest_search(drive))
        code = pending_error(who, line, address, mark, mode)
        if code:
            raise DeviceError(who, f"found no home: {error_named(code).sentence}", "look at it")
        home = drive.steps(drive.home_position)
        line.tell(address, f"P={home}", mode)
        _expect(who, line, address, mode, {"P": home})
        line.tell(address, f"{mark}={HOMED}", mode)
        _expect(who, line, address, mode, {mark: HOMED})
    finally:
        line.tell(address, "SL 0", mode)
        line.tell(address, f"VM={drive.rate(drive.speed)}", mode)
    _expect(who, line, address, mode, {"VM": drive.rate(drive.speed)})
    return home


def wait_for_rest(
    who: str, line: Line, drive: DriveSettings, mode: Mode, longest: float = 0.0
) -> None:
    """Until it stands.

    Raises:
        DeviceError: not within `longest` [s] and the time of its ramp.
        Stopped: a stop was requested; it was told to stop.
    """
    allowed = longest + drive.speed / drive.acceleration + _SLOW
    end = time.monotonic() + allowed
    while _ask(who, line, drive.address, mode, ["MV"])[0]:
        if requested() is not None:
            line.tell(drive.address, "SL 0", mode)
            check()
        if time.monotonic() > end:
            line.tell(drive.address, "SL 0", mode)
            raise DeviceError(who, f"still moves after {allowed:.1f} s", "look at it")
        time.sleep(0.01)


def _longest_search(drive: DriveSettings) -> float:
    low, high = drive.travel
    creep = drive.rate(drive.home_speed) ** 2 / (2.0 * drive.rate(drive.acceleration))
    return 1.5 * (high - low) / drive.home_speed + 3.0 * creep / drive.rate(drive.initial_speed)


def _ask(who: str, line: Line, address: str, mode: Mode, items: list[str]) -> tuple[int, ...]:
    answer = line.ask(address, items, mode)
    if answer is None or len(answer) < len(items):
        raise DeviceError(who, f"does not tell {' and '.join(items)}", "check the line and power")
    return answer


def _expect(who: str, line: Line, address: str, mode: Mode, wanted: dict[str, int]) -> None:
    """Read back, a few at a time: a drive's buffer is short."""
    names = list(wanted)
    for some in (names[k : k + 4] for k in range(0, len(names), 4)):
        answer = _ask(who, line, address, mode, some)
        for register, value in zip(some, answer, strict=True):
            if value != wanted[register]:
                raise _otherwise(who, register, value, wanted[register])


def _otherwise(who: str, register: str, found: object, wanted: object) -> DeviceError:
    problem = f"{register} is {found}, not {wanted} as written"
    return DeviceError(who, problem, "set it in the drive, or correct the settings")
