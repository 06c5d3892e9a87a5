"""A guard round any plant: nothing leaves unarmed, nothing leaves that the rules forbid, and what
goes wrong ends in the safe state with a sentence.

Safe while floating: stages stop and hold, wheels get zero torque and are not braked, gimbals
stand, rotors keep their speed, coils are off, thrusters closed. Nothing goes back to zero: a mass
that runs to its end throws a floating table.
"""

from collections import Counter
from collections.abc import Iterator
from enum import Enum

import numpy as np

from twin.errors import SafetyError, UsageError
from twin.plant.guard.actuators import ActuatorMonitor
from twin.plant.guard.rules import GuardSettings, Observed, Rules, Watchdog
from twin.plant.limits import Limits
from twin.plant.plant import Plant
from twin.signals import Command, Reading, Samples

YES = "arm"
"""What the operator types to arm, once a session and after each stop."""


class GuardPhase(Enum):
    """What the guard lets through."""

    disarmed = "Nothing leaves: it is read and computed only."
    armed = "Commands leave, within the rules."
    stopped = "It was brought to its safe state and must be armed anew."


class Held(Enum):
    """What the operator says where no signal does; the value is the word to type."""

    floating = "floating"
    captured = "captured"
    """The air is off or the table is clamped, and somebody has looked."""


class Guarded(Plant):
    """One machine behind its guard."""

    def __init__(self, plant: Plant, settings: GuardSettings, *, calibrated: bool) -> None:
        """Disarmed, always.

        Args:
            plant: of one run.
            settings: the laboratory's numbers.
            calibrated: whether the machine's calibration was read.

        Raises:
            UsageError: a batch of runs.
        """
        if plant.n != 1:
            raise UsageError(f"a guard is for one machine, not for a batch of {plant.n}")
        self.platform = plant.platform
        self.n = 1
        self.stopped = {}
        self.phase = GuardPhase.disarmed
        self.seen = Observed(self.platform)
        self.settings = settings
        self._plant, self._calibrated = plant, calibrated
        self._rules = Rules(self.platform, settings)
        self._limits = Limits(self.platform)
        self._monitor = ActuatorMonitor(self.platform)
        self._word: Held | None = None
        self._applied: Command = {}
        self._watchdog: Watchdog | None = None
        self._carried = False
        """As the signal of the air said last; the operator's word is no signal."""

    @property
    def limited(self) -> Counter[str]:
        """Ticks in which each rule changed a command."""
        return self._rules.count

    @property
    def floating(self) -> bool:
        """As a signal or the operator says; where neither does, or it fell silent, it may float."""
        return self._floats(self._word)

    def arm(self, said: str, *, held: Held | None = None) -> None:
        """Let commands through from now on.

        Args:
            said: what the operator typed for it, this session: "arm".
            held: whether it floats, typed by the operator where no signal says so.

        Raises:
            SafetyError: why not; the machine stays as it is.
            DeviceError: a device refuses.
        """
        if said != YES:
            raise SafetyError("not armed: nobody has said so", f"type {YES!r}, each session")
        for refusal in self.refusals(held):
            raise refusal
        self._word = held
        self._plant.engage()
        self._applied = self._rest()
        self.stopped = {}
        self.safe_reason = ""
        self._carried = self._air is True
        self._monitor = ActuatorMonitor(self.platform)
        self._end_watchdog()
        if np.isfinite(self.settings.watchdog):
            self._watchdog = Watchdog(self.settings.watchdog, self._quiet)
        self.phase = GuardPhase.armed

    def refusals(self, held: Held | None = None) -> Iterator[SafetyError]:
        """Why it would not be armed now, the gravest first; nothing: it would.

        Args:
            held: as for `arm`.
        """
        if not self._calibrated:
            yield SafetyError(
                "not armed: no calibration file", "calibrate this machine and name its file"
            )
        try:
            self._check_held(held)
        except SafetyError as refusal:
            yield refusal
        if (stale := self.seen.stale(1)) is not None:
            yield SafetyError(
                f"not armed: no fresh sample of {stale} ({_seconds(self.seen.age(stale))})"
                f"{self._why_bad(stale)}",
                "read until every stream runs, and check the device that is silent",
            )
        if self._plant.doubt:
            yield SafetyError(
                f"not armed: {self._plant.doubt}",
                "look at both sensors, their axes and their signs in [hardware]",
            )
        lean = self.seen.lean
        if np.isfinite(self.settings.tilt_cutout) and lean is None:
            yield SafetyError(
                "not armed: no sensor tells the tilt, so that nothing could cut out",
                "add one, or set tilt_cutout = inf and watch it",
            )
        if lean is not None and lean > self.settings.tilt_cutout:
            yield SafetyError(f"not armed: {self._tilted(lean)}", "level it first")
        if self.platform.stages and self.seen.stage_position is None:
            yield SafetyError(
                "not armed: nobody has measured where the stages are", "home them, captured"
            )
        if self._floats(held) and self.seen.lost:
            yield SafetyError(f"not armed: {self.seen.lost}", "capture it first, then home")

    def captured(self) -> None:
        """The operator says that the table is held: positions may be established anew.

        Raises:
            SafetyError: a signal says that it floats.
        """
        self._check_held(Held.captured)
        self._word = Held.captured
        self.seen.captured()

    def captured_only(self, what: str) -> None:
        """Homing, zeroing and moves from end to end come through here.

        Raises:
            SafetyError: it floats, or may.
        """
        if self.floating:
            raise SafetyError(
                f"{what} refused: the table floats, and a mass that runs to its end throws it",
                "capture it (air off or clamped), confirm that, then try again",
            )

    def disarm(self) -> None:
        """Safe, and nothing leaves from now on."""
        if self.phase is GuardPhase.armed:
            self._make_safe()
        self.phase = GuardPhase.disarmed
        self._plant.disengage()
        self._end_watchdog()

    def stop(self, reason: str) -> None:
        """Bring it to its safe state, because of `reason`; the run ends with it."""
        if self.phase is not GuardPhase.armed:
            return
        self.phase = GuardPhase.stopped
        self.safe_reason = reason
        self.stopped[0] = reason
        self._make_safe()

    def read(self, until: float) -> Reading:
        reading = self._plant.read(until)
        self.seen.take(reading)
        if self.phase is GuardPhase.armed:
            reason = self._plant.stopped.get(0) or self._danger() or self._monitor.take(reading)
            if reason:
                self.stop(reason)
        elif self._plant.stopped and not self.safe_reason:
            # a dry run ends with what it reads from
            self.safe_reason = self.stopped[0] = self._plant.stopped[0]
        return reading

    def write(self, command: Command) -> Command:
        self._limits.check(command, self.n)
        for name, value in command.items():
            if not np.isfinite(value).all():
                column = int(np.argmin(np.isfinite(value[0])))
                what = self.platform.columns(name)[column]
                self.stop(f"{name} {what} is {value[0, column]}: the law has failed")
        if self.phase is not GuardPhase.armed:
            return self._applied or self._rest()
        # once: it ends itself, in its own thread, when it barks
        watchdog = self._watchdog
        if watchdog is not None:
            watchdog.feed()
        # what is held is weighed again too: a torque that was allowed once fills a wheel in time
        wanted = self._applied | command
        applied = self._plant.write(self._rules.limited(wanted, self.seen, floating=self.floating))
        if self.safe_reason:
            # the watchdog has barked meanwhile, and this command came after its stop
            self._make_safe()
        else:
            self._applied = applied
            self.seen.add_wheel_torque(applied, self.platform.tick)
            self._monitor.take_command(applied)
        return dict(self._applied)

    def truth(self) -> dict[str, Samples]:
        return self._plant.truth()

    def close(self) -> None:
        self.disarm()
        self._plant.close()

    @property
    def _air(self) -> bool | None:
        return self.seen.floating(self.settings.air_pressure)

    def _floats(self, word: Held | None) -> bool:
        signal = self._air
        if signal is None:
            return word is not Held.captured or bool(self.seen.silent_air)
        return signal or word is Held.floating

    def _check_held(self, held: Held | None) -> None:
        signal, silent = self._air, self.seen.silent_air
        if silent:
            raise SafetyError(
                f"{silent} told of the air and has been silent for "
                f"{_seconds(self.seen.age(silent))}, so that it may float",
                "check the device that sends it, or take it out of [hardware] and go by the word",
            )
        if signal is None and held is None:
            raise SafetyError(
                "not armed: no signal says whether it floats",
                "look, and type 'floating' or 'captured'",
            )
        if signal and held is Held.captured:
            raise SafetyError(
                "the air says that it floats, the operator that it is captured",
                "turn the air off or clamp the table; never go by the word alone",
            )
        if signal is False and held is Held.floating:
            raise SafetyError(
                "the operator says that it floats, the air that it does not",
                "turn the air on, or look at the sensor of it; never go by the word alone",
            )

    def _danger(self) -> str:
        """Why it must stop now; empty: it need not."""
        lean = self.seen.lean
        if lean is not None and lean > self.settings.tilt_cutout:
            return self._tilted(lean)
        rate = self.seen.rate
        if rate is not None and rate > self.settings.rate_cutout:
            return (
                f"it turns by {np.degrees(rate):.1f} deg/s, more than the "
                f"{np.degrees(self.settings.rate_cutout):.1f} deg/s at which all stops"
            )
        stale = self.seen.stale(self.settings.stale_cycles)
        if stale is not None:
            return (
                f"{stale} is stale: nothing valid for {_seconds(self.seen.age(stale))}, in "
                f"{self.settings.stale_cycles} periods{self._why_bad(stale)}"
            )
        if self._plant.doubt:
            return self._plant.doubt
        signal = self._air
        if self._carried and signal is False:
            return "the air was lost: the table is coming down"
        if self.floating and self.seen.lost:
            return f"{self.seen.lost}; masses hold, wheels coast: capture it first"
        self._carried = self._carried if signal is None else signal
        return ""

    def _why_bad(self, stream: str) -> str:
        reason = self._plant.why_bad(stream)
        return f"; {reason}" if reason else ""

    def _tilted(self, lean: float) -> str:
        return (
            f"it leans by {np.degrees(lean):.1f} deg, more than the "
            f"{np.degrees(self.settings.tilt_cutout):.1f} deg at which all stops"
        )

    def _quiet(self, seconds: float) -> None:
        self.stop(f"no command for {seconds:.2f} s: the loop has stopped or hangs")

    def _make_safe(self) -> None:
        self._end_watchdog()
        self._applied = self._rest()
        self._plant.safe_stop(self._applied, floating=self.floating)

    def _rest(self) -> Command:
        """Nothing pushes, and stages hold where their ramps let them stop."""
        rest = {name: np.zeros((1, width)) for name, width in self.platform.commands.items()}
        place = self.seen.stage_position
        if "command_stage_position" in rest and place is not None:
            told = self._applied.get("command_stage_position", place[None])[0]
            ramp = np.array([0.5 * s.speed**2 / s.acceleration for s in self.platform.stages])
            rest["command_stage_position"] = (place + np.clip(told - place, -ramp, ramp))[None]
        return rest

    def _end_watchdog(self) -> None:
        watchdog, self._watchdog = self._watchdog, None
        if watchdog is not None:
            watchdog.stop()


def _seconds(age: float) -> str:
    return "never one" if np.isinf(age) else f"{age:.2f} s"
