"""Each actuator moved a little before a law may command it, and held against its prediction.

What a command to one actuator should do: to the body, and to what the actuator itself shows.
Each is linear in the command u(t) that was applied, so it is predicted from the platform alone:

    wheel      -a u              thruster   r x d u
    coils      e_k x B u         gimbal     -(g x H) u, H what it carries

on the body [N m], and on its own reading  u / I  a wheel's speed,  u  a gimbal's angle.

The turn of the floating body and the actuator's own reading are predicted from the platform. One
that does the opposite, or nothing where something would be seen, refuses the session; what cannot
be told (a captured table shows no turn, a mass that runs up and down hardly one) is said.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from functools import partial
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.clock import Clock
from twin.errors import SafetyError
from twin.platform import Platform
from twin.rotation import conjugate, cross, rotate
from twin.service.sense import (
    FloatingMotion,
    ObservedShare,
    at,
    carried_axes,
    motion,
    rows,
    senses,
    shares,
    slid,
    speeds,
)
from twin.service.session import MOVE, POSITION, Session
from twin.service.stages import in_mm, tolerance
from twin.signals import Command, Reading, stream_named

Array = NDArray[np.float64]


OWN = {"command_wheel_torque": "wheel_speed", "command_gimbal_rate": "gimbal_angle"}
"""Command -> the stream that shows its integral."""

Applied = Sequence[tuple[float, Command]]
"""Commands and from when on each was applied [s]."""


def lever(
    platform: Platform, readings: Sequence[Reading], times: Array, stream: str, column: int
) -> Array | None:
    """Torque on the body (m, 3) for each unit of a command.

    Returns:
        None where it cannot be told: no field is known, or nothing turns a free body by it.
    """
    shape = (len(times), 3)
    match stream:
        case "command_wheel_torque":
            return -carried_axes(platform, readings, times)[column]
        case "command_thruster":
            part = platform.thrusters[column]
            return np.broadcast_to(np.cross(part.point, part.direction), shape)
        case "command_dipole":
            field = _field(platform, readings, times)
            return (
                None if field is None else cross(np.broadcast_to(np.eye(3)[column], shape), field)
            )
        case "command_gimbal_rate":
            gimbal = platform.gimbals[column]
            carried = np.zeros(shape)
            parts = (*platform.wheels, *platform.rotors)
            axes, turning = (part(platform, readings, times) for part in (carried_axes, speeds))
            for part, axis, speed in zip(parts, axes, turning, strict=True):
                if part.gimbal == gimbal.name:
                    carried = carried + part.inertia * speed[:, None] * axis
            return -cross(np.broadcast_to(gimbal.axis, shape), carried)
        case _:
            return None


def turned(
    platform: Platform,
    readings: Sequence[Reading],
    applied: Applied,
    motion: FloatingMotion,
    stream: str,
    column: int,
) -> Array | None:
    """Change of the rate (m, 3) that a command should have made since the start [rad/s].

    Returns:
        As `lever`.
    """
    torque = lever(platform, readings, motion.times, stream, column)
    if torque is None:
        return None
    pushed = np.diff(pushes(applied, motion.times, stream, column))[:, None]
    pieces = 0.5 * (torque[1:] + torque[:-1]) * pushed
    angular = np.concatenate([np.zeros((1, 3)), np.cumsum(pieces, axis=0)])
    return angular @ np.linalg.inv(platform.inertia)


def pushes(applied: Applied, times: Array, stream: str, column: int) -> Array:
    """(m,) integral of what was applied, up to each time."""
    begun = np.array([time for time, _ in applied])
    value = np.array([command[stream][0, column] for _, command in applied])
    ends = np.append(begun, max(float(begun[-1]), float(times[-1])))
    whole = np.concatenate([[0.0], np.cumsum(value * np.diff(ends))])
    return np.interp(times, ends, whole)


def reading_gain(platform: Platform, stream: str, column: int) -> float:
    """Of an actuator's own reading, for each unit of its pushes."""
    return 1.0 / platform.wheels[column].inertia if "wheel" in stream else 1.0


def limit(platform: Platform, stream: str, column: int) -> float:
    """The largest command."""
    match stream:
        case "command_wheel_torque":
            return platform.wheels[column].torque_limit
        case "command_thruster":
            return platform.thrusters[column].force_limit
        case "command_gimbal_rate":
            return platform.gimbals[column].rate
        case "command_dipole":
            return min(coil.dipole_limit for coil in platform.magnetorquers)
        case _:
            return platform.base.torque_limit


def _field(platform: Platform, readings: Sequence[Reading], times: Array) -> Array | None:
    """B (m, 3) in body axes [T]: the stated one, which laws go by, or as it is measured."""
    attitude = rows(readings, "attitude")
    if attitude is not None and np.any(platform.magnetic_field):
        turns = attitude[1][np.argmin(np.abs(times[:, None] - attitude[0]), axis=1)]
        return rotate(conjugate(turns), np.broadcast_to(platform.magnetic_field, (len(times), 3)))
    measured = rows(readings, "magnetometer")
    return None if measured is None else at(times, *measured)


LATE = 0.2
"""A stage's reading follows its move by no more [s]."""

_DULL = 0.1
"""With a share known so well (1 sigma), nothing seen means that nothing happened."""

Actuator = tuple[str, int]
"""Command stream and column."""


@dataclass(frozen=True)
class Evidence:
    """One prediction and what was seen of it."""

    predicted: str
    """In words."""
    where: str
    """The sensor."""
    share: ObservedShare

    def words(self) -> str:
        """All of it."""
        told = f"predicted {self.predicted}, {self.where} showed {self.share.words()} of it"
        return told if self.share.sign_known else f"{told}, which does not tell the sign"

    @property
    def refused(self) -> str:
        """What is wrong; empty: nothing, or it cannot be told."""
        if self.share.sign_known:
            return "" if self.share.share > 0.0 else "it acts the wrong way round"
        return "it does nothing" if self.share.deviation < _DULL else ""


def body_evidence(session: Session, pushed: Sequence[Actuator], begun: float) -> Evidence | None:
    """What the gyro saw of the last of those that have pushed.

    Args:
        session: with all that was read and applied since before the first push.
        pushed: all of them, in their order: each has left its turn.
        begun: when the last one began [s].

    Returns:
        None where nothing is predicted, or too little was read.
    """
    platform = session.platform
    seen = motion(platform, session.readings)
    if seen is None:
        return None
    predicted = [_turn(session, seen, *each) for each in pushed]
    last = predicted[-1]
    if last is None or not np.any(last):
        return None
    known = [each for each in predicted if each is not None and np.any(each)]
    result = senses(platform, seen, known)
    return None if result is None else Evidence(_peak(seen, last, begun), "the gyro", result[-1])


def actuator_evidence(session: Session, stream: str, column: int) -> Evidence | None:
    """What the actuator shows itself; None where it shows nothing, or was told nothing."""
    platform, applied = session.platform, session.applied
    source = reading_stream(stream)
    read = rows(session.readings, source) if source else None
    if read is None:
        return None
    times, values = read
    if stream == MOVE:
        told = _held(applied, times, column)
        part, most = platform.stages[column], in_mm(float(np.ptp(told)))
        # only where it has had the time to get there
        takes = float(np.ptp(told)) / part.speed + part.speed / part.acceleration
        there = told == _held(applied, times - takes - part.response - LATE, column)
        times, values, told = times[there], values[there], told[there]
        noise = float(tolerance(platform)[column])
    else:
        told = pushes(applied, times, stream, column)
        told = told * reading_gain(platform, stream, column)
        sensor = platform.sensors[source]
        noise = float(np.max(sensor.noise)) + sensor.resolution
        unit = stream_named(source).unit
        most = f"{float(np.ptp(told)):.3g} {unit}"
    share = _fitted(times, values[:, column], told, max(noise, 1e-12))
    return None if share is None else Evidence(f"a change of {most}", source, share)


def reading_stream(stream: str) -> str:
    """What shows what such an actuator does; empty: nothing does."""
    return POSITION if stream == MOVE else OWN.get(stream, "")


def _turn(session: Session, motion: FloatingMotion, stream: str, column: int) -> Array | None:
    platform = session.platform
    if stream == MOVE:
        return slid(platform, motion, column) if motion.places.size else None
    return turned(platform, session.readings, session.applied, motion, stream, column)


def _peak(motion: FloatingMotion, predicted: Array, begun: float) -> str:
    """The largest change of the rate since then, in words."""
    during = predicted[motion.times >= begun]
    change = during - during[0] if len(during) else predicted
    row, axis = np.unravel_index(int(np.argmax(np.abs(change))), change.shape)
    return f"a turn of {np.degrees(change[row, axis]):+.3g} deg/s about {'xyz'[int(axis)]}"


def _held(applied: Applied, times: Array, column: int) -> Array:
    """(m,) position [m] that a stage was told to hold at each time."""
    begun = np.array([time for time, _ in applied])
    told = np.array([command[MOVE][0, column] for _, command in applied])
    return told[np.maximum(np.searchsorted(begun, times, side="right") - 1, 0)]


def _fitted(times: Array, values: Array, commanded: Array, noise: float) -> ObservedShare | None:
    """Share of `told` in values that also drift at a steady pace; None: nothing was told."""
    if np.ptp(commanded) == 0.0 or len(times) < 5:
        return None
    design = np.stack([np.ones_like(times), times - times[0], commanded], axis=1)
    return shares(design / noise, values / noise, len(times))[-1]


_BEFORE = 0.5
"""A floating body is watched so long before anything pushes [s]."""

_CLEAR = 30.0
"""A push should change what is read by so many times its noise."""

_FASTEST = 0.02
"""No push changes the body's rate by more [rad/s]."""

_SHARE = 0.5
"""Of an actuator's limit, and 0.9 of what the guard lets a stage move, that is used."""

_ROUNDS = 3

_BACK = 10.0
"""Tolerances by which a stage must read to have gone the wrong way before it is called wrong."""

_LONGEST = 2.0
"""A push lasts twice as long in each round, but no longer than this [s]."""

_HOPELESS = 1.5
"""A share known no better after one round will not tell a sign after all [1 sigma]."""


def armed(bench: Bench, streams: Collection[str], tell: Callable[[str], None]) -> Clock:
    """Watch a machine, arm it if that was said, and try what its law will command.

    Args:
        bench: entered.
        streams: commands of the law.
        tell: takes a sentence for each actuator.

    Returns:
        The clock whose first tick is at hand.

    Raises:
        SafetyError: why it is not armed; which actuator does otherwise than predicted.
        DeviceError: a device refuses.
    """
    if not bench.to_be_armed:
        return bench.begin()
    session = Session(bench)
    # kept as it grows, so that it is there whatever ends it
    bench.trial_readings, bench.trial_applied = session.readings, session.applied
    for sentence in first_use(session, streams):
        tell(sentence)
    return bench.begin_anew()


def first_use(session: Session, streams: Collection[str]) -> list[str]:
    """Try every actuator that a device carries and one of the streams commands.

    Args:
        session: armed, at its beginning.
        streams: command streams.

    Returns:
        A sentence for each.

    Raises:
        SafetyError: one does the opposite of what is predicted, or nothing; all is at rest then.
    """
    trial = _Trial(session)
    told = session.bench.trial_told
    for route in session.bench.hardware.setup.commanded:
        if route.stream in streams:
            for column in route.columns:
                told.append(trial.tried(route.stream, column))
    return told


class _Trial:
    """Actuators one after the other; a prediction for all that have pushed so far."""

    def __init__(self, session: Session) -> None:
        self._session, self._platform = session, session.platform
        self._free = (
            session.bench.guard.floating
            and self._platform.base.kind == "ball"
            and "gyro" in self._platform.sensors
        )
        self._pushed: list[Actuator] = []
        self._rest: Command = {
            name: np.zeros((1, width)) for name, width in self._platform.commands.items()
        }
        if MOVE in self._rest:
            session.step({})
            self._rest[MOVE] = session.places[None]
        session.watch(self._rest, _BEFORE)

    def tried(self, stream: str, column: int) -> str:
        """Push with one until it is told; a sentence.

        Raises:
            SafetyError: it refuses the session.
        """
        name = self._name(stream, column)
        if not self._tells(stream, column):
            return f"first use of {name}: {self._untold} what it does; it was not pushed"
        size, seconds = self._size(stream, column)
        self._pushed.append((stream, column))
        result: list[Evidence] = []
        for number in range(_ROUNDS):
            lasts = max(min(seconds * 2**number, _LONGEST), seconds)
            begun = self._session.now
            for part in self._profile(stream, column, size):
                command = {key: value.copy() for key, value in self._rest.items()}
                command[stream][0, column] += part * size
                self._hold(command, lasts, (stream, column))
            result = self._session.meanwhile(partial(self._evidence, begun), self._rest)
            if all(each.share.sign_known or each.share.deviation > _HOPELESS for each in result):
                break
        for each in result:
            if each.refused:
                self._refuse(name, f"{each.words()}; {each.refused}")
        lines = [each.words() for each in result]
        if not self._free:
            lines.append(f"{self._untold} whether it turns the body the right way")
        return f"first use of {name}: " + "; ".join(lines)

    @property
    def _untold(self) -> str:
        held = not self._session.bench.guard.floating
        return "while it is captured nothing shows" if held else "no sensor shows"

    def _tells(self, stream: str, column: int) -> bool:
        """Something will show what it does."""
        if reading_stream(stream) in self._platform.sensors:
            return True
        times = np.array([self._session.now])
        readings = self._session.readings
        return self._free and lever(self._platform, readings, times, stream, column) is not None

    def _evidence(self, begun: float, session: Session) -> list[Evidence]:
        """All that tells of the last of those that have pushed."""
        body = body_evidence(session, self._pushed, begun) if self._free else None
        evidence = actuator_evidence(session, *self._pushed[-1])
        return [each for each in (body, evidence) if each is not None]

    def _hold(self, command: Command, seconds: float, pushed: Actuator) -> None:
        """Go on under a command; a stage that runs the other way is stopped at once."""
        session, (stream, column) = self._session, pushed
        start = session.places[column] if stream == MOVE else 0.0
        way = command[stream][0, column] - start
        for _ in range(round(seconds / session.tick)):
            session.step(command)
            gone = session.places[column] - start if stream == MOVE else 0.0
            if stream == MOVE and gone * np.sign(way) < -_BACK * tolerance(self._platform)[column]:
                self._refuse(
                    self._name(*pushed),
                    f"predicted a change of {in_mm(way)}, {POSITION} showed one of {in_mm(gone)}",
                )

    def _refuse(self, name: str, sentence: str) -> NoReturn:
        if MOVE in self._rest:
            # no way back: what is wired the wrong way round holds where it is
            self._rest[MOVE] = self._session.places[None]
        self._session.step(self._rest)
        raise SafetyError(
            f"first use of {name} refused: {sentence}",
            "look whether it has its power, and correct its wiring, or the sign of its scale or of "
            "the sensor's, in [hardware]",
        )

    def _name(self, stream: str, column: int) -> str:
        return f"{self._platform.columns(stream)[column]} ({stream})"

    def _size(self, stream: str, column: int) -> tuple[float, float]:
        """Of a push, and how long each part of it lasts [s]."""
        platform, session = self._platform, self._session
        sensor = platform.sensors.get(reading_stream(stream))
        gyro = platform.sensors.get("gyro")
        # a free body falls meanwhile: what is read slowly is waited for where nothing else tells
        telling = gyro if self._free and stream != MOVE else sensor
        seconds = max(0.25, 4.0 * session.tick, 0.0 if telling is None else 4.0 / telling.rate)
        wish = 0.0 if gyro is None else _CLEAR * float(np.max(gyro.noise))
        wish = min(max(wish, 1e-5), _FASTEST)
        if stream == MOVE:
            part, settings = platform.stages[column], session.bench.guard.settings
            weight = part.mass * platform.gravity
            seconds = max(0.6, seconds)
            turn = weight * np.abs(np.linalg.inv(platform.inertia)[:2, :2]).max() * seconds
            clear = 20.0 * float(tolerance(platform)[column])
            most = min(0.9 * settings.max_balance_step / weight, 0.2 * part.speed * seconds)
            size = min(max(wish / turn, clear), most)
            takes = 2.0 * size / part.speed + part.speed / part.acceleration + part.response
            return size, max(seconds, takes + 2.0 * LATE)
        most = _SHARE * limit(platform, stream, column)
        times = np.array([session.now])
        torque = lever(platform, session.readings, times, stream, column)
        inverse = np.linalg.inv(platform.inertia)
        turn = 0.0 if torque is None else float(np.abs(torque @ inverse).max()) * seconds
        needed = wish / turn if turn > 0.0 else np.inf
        if sensor is not None:
            noise = float(np.max(sensor.noise)) + sensor.resolution
            gain = reading_gain(platform, stream, column) * seconds
            own = _CLEAR * noise / gain
            # its own reading may ask for more than the gyro, as far as the body is to turn
            needed = own if not np.isfinite(needed) else max(needed, min(own, _FASTEST / turn))
        return (min(needed, most) if np.isfinite(needed) else most), seconds

    def _profile(self, stream: str, column: int, size: float) -> tuple[float, ...]:
        """Parts of the size, one after the other: what pushed one way pushes the other too."""
        if stream == "command_thruster":
            return (1.0, 0.0)
        if stream == MOVE:
            part, place = self._platform.stages[column], float(self._rest[MOVE][0, column])
            margin = self._session.bench.guard.settings.stroke_margin
            if place + size > part.travel[1] - margin:
                return (-1.0, 0.0)
            if place - size < part.travel[0] + margin:
                return (1.0, 0.0)
        return (1.0, -1.0, 0.0)
