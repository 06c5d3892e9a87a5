"""Before a law may command them: each actuator moved a little, and held against what it should do.

The turn of the floating body and the actuator's own reading are predicted from the platform. One
that does the opposite, or nothing where something would be seen, refuses the session; what cannot
be told (a captured table shows no turn, a mass that runs up and down hardly one) is said.
"""

from collections.abc import Callable, Collection
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from twin.bench import Bench
from twin.clock import Clock
from twin.errors import SafetyError
from twin.service.push import OWN, Applied, lever, limit, own_gain, pushes, turned
from twin.service.sense import Motion, Sense, motion, rows, senses, slid
from twin.service.session import MOVE, POSITION, Session
from twin.service.stages import in_mm, tolerance
from twin.signals import Command, stream_named

Array = NDArray[np.float64]

_BEFORE = 0.5
"""A floating body is watched so long before anything pushes [s]."""

_CLEAR = 30.0
"""A push should change what is read by so many times its noise."""

_FASTEST = 0.02
"""No push changes the body's rate by more [rad/s]."""

_SHARE = 0.5
"""Of an actuator's limit, and 0.9 of what the guard lets a stage move, that is used."""

_DULL = 0.1
"""With a share known so well (1 sigma), nothing seen means that nothing happened."""

_ROUNDS = 3

_BACK = 10.0
"""Tolerances by which a stage must read to have gone the wrong way before it is called wrong."""

_LATE = 0.2
"""A stage's reading follows its move by no more [s]."""

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
    for sentence in first_use(Session(bench), streams):
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
    told: list[str] = []
    for route in session.bench.hardware.setup.commanded:
        if route.stream in streams:
            told += [trial.tried(route.stream, column) for column in route.columns]
    return told


@dataclass(frozen=True)
class _Seen:
    """One prediction and what was seen of it."""

    predicted: str
    """In words."""
    where: str
    share: Sense

    def words(self) -> str:
        told = f"predicted {self.predicted}, {self.where} showed {self.share.words()} of it"
        return told if self.share.seen else f"{told}, which does not tell the sign"

    @property
    def refused(self) -> str:
        """What is wrong; empty: nothing, or it cannot be told."""
        if self.share.seen:
            return "" if self.share.share > 0.0 else "it acts the wrong way round"
        return "it does nothing" if self.share.deviation < _DULL else ""


class _Trial:
    """Actuators one after the other; a prediction for all that have pushed so far."""

    def __init__(self, session: Session) -> None:
        self._session, self._platform = session, session.platform
        self._floating = session.bench.guard.floating and self._platform.base.kind == "ball"
        self._pushed: list[tuple[str, int]] = []
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
        size, seconds = self._size(stream, column)
        self._pushed.append((stream, column))
        found: list[_Seen] = []
        for number in range(_ROUNDS):
            lasts = max(min(seconds * 2**number, _LONGEST), seconds)
            begun = self._session.now
            for part in self._profile(stream, column, size):
                command = {key: value.copy() for key, value in self._rest.items()}
                command[stream][0, column] += part * size
                self._hold(command, lasts, (stream, column))
            found = self._found(stream, column, begun)
            if all(each.share.seen or each.share.deviation > _HOPELESS for each in found):
                break
        for each in found:
            if each.refused:
                self._refuse(name, f"{each.words()}; {each.refused}")
        lines = [each.words() for each in found]
        if not self._floating:
            lines.append("whether it turns the body the right way is not to be seen while captured")
        elif not found:
            lines.append("no sensor tells what it does: look at it")
        return f"first use of {name}: " + "; ".join(lines)

    def _hold(self, command: Command, seconds: float, pushed: tuple[str, int]) -> None:
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
        sensor = platform.sensors.get(POSITION if stream == MOVE else OWN.get(stream, ""))
        gyro = platform.sensors.get("gyro")
        # a free body falls meanwhile: what is read slowly is waited for where nothing else tells
        needed = gyro if self._floating and gyro is not None and stream != MOVE else sensor
        seconds = max(0.25, 4.0 * session.tick, 0.0 if needed is None else 4.0 / needed.rate)
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
            return size, max(seconds, takes + 2.0 * _LATE)
        most = _SHARE * limit(platform, stream, column)
        times = np.array([session.now])
        torque = lever(platform, session.readings, times, stream, column)
        inverse = np.linalg.inv(platform.inertia)
        turn = 0.0 if torque is None else float(np.abs(torque @ inverse).max()) * seconds
        needed = wish / turn if turn > 0.0 else np.inf
        if sensor is not None:
            noise = float(np.max(sensor.noise)) + sensor.resolution
            gain = own_gain(platform, stream, column) * seconds
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

    def _found(self, stream: str, column: int, begun: float) -> list[_Seen]:
        """All that tells of the last of those that have pushed."""
        found: list[_Seen] = []
        seen = motion(self._platform, self._session.readings) if self._floating else None
        if seen is not None:
            predicted = [self._predicted(seen, *each) for each in self._pushed]
            known = [each for each in predicted if each is not None and np.any(each)]
            if predicted[-1] is not None and np.any(predicted[-1]):
                shares = senses(self._platform, seen, known)
                if shares is not None:
                    found.append(_Seen(_peak(seen, predicted[-1], begun), "the gyro", shares[-1]))
        own = self._own(stream, column)
        return [*found, own] if own is not None else found

    def _predicted(self, seen: Motion, stream: str, column: int) -> Array | None:
        if stream == MOVE:
            return slid(self._platform, seen, column) if seen.places.size else None
        session = self._session
        return turned(self._platform, session.readings, session.applied, seen, stream, column)

    def _own(self, stream: str, column: int) -> _Seen | None:
        """What the actuator shows itself."""
        source = POSITION if stream == MOVE else OWN.get(stream)
        read = None if source is None else rows(self._session.readings, source)
        if read is None or source is None:
            return None
        times, values = read
        applied = self._session.applied
        if stream == MOVE:
            told = _held(applied, times, column)
            part, most = self._platform.stages[column], in_mm(float(np.ptp(told)))
            # only where it has had the time to get there
            takes = float(np.ptp(told)) / part.speed + part.speed / part.acceleration
            there = told == _held(applied, times - takes - part.response - _LATE, column)
            times, values, told = times[there], values[there], told[there]
            noise = float(tolerance(self._platform)[column])
        else:
            told = pushes(applied, times, stream, column)
            told = told * own_gain(self._platform, stream, column)
            sensor = self._platform.sensors[source]
            noise = float(np.max(sensor.noise)) + sensor.resolution
            unit = stream_named(source).unit
            most = f"{float(np.ptp(told)):.3g} {unit}"
        share = _fitted(times, values[:, column], told, max(noise, 1e-12))
        return None if share is None else _Seen(f"a change of {most}", source, share)


def _peak(seen: Motion, predicted: Array, begun: float) -> str:
    """The largest change of the rate since then, in words."""
    during = predicted[seen.times >= begun]
    change = during - during[0] if len(during) else predicted
    row, axis = np.unravel_index(int(np.argmax(np.abs(change))), change.shape)
    return f"a turn of {np.degrees(change[row, axis]):+.3g} deg/s about {'xyz'[int(axis)]}"


def _held(applied: Applied, times: Array, column: int) -> Array:
    """(m,) position [m] that a stage was told to hold at each time."""
    begun = np.array([time for time, _ in applied])
    told = np.array([command[MOVE][0, column] for _, command in applied])
    return told[np.maximum(np.searchsorted(begun, times, side="right") - 1, 0)]


def _fitted(times: Array, values: Array, told: Array, noise: float) -> Sense | None:
    """Share of `told` in values that also drift at a steady pace; None: nothing was told."""
    if np.ptp(told) == 0.0 or len(times) < 5:
        return None
    design = np.stack([np.ones_like(times), times - times[0], told], axis=1) / noise
    size = np.linalg.norm(design, axis=0)
    found, *_ = np.linalg.lstsq(design / size, values / noise, rcond=None)
    left = values / noise - design / size @ found
    worse = max(float(left @ left) / len(times), 1.0)
    covariance = worse * np.linalg.pinv((design / size).T @ (design / size))
    return Sense(float(found[-1] / size[-1]), float(np.sqrt(covariance[-1, -1]) / size[-1]))
