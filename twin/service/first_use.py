"""Before a law may command them: each actuator moved a little, and held against what it should do.

The turn of the floating body and the actuator's own reading are predicted from the platform. One
that does the opposite, or nothing where something would be seen, refuses the session; what cannot
be told (a captured table shows no turn, a mass that runs up and down hardly one) is said.
"""

from collections.abc import Callable, Collection
from functools import partial
from typing import NoReturn

import numpy as np

from twin.bench import Bench
from twin.clock import Clock
from twin.errors import SafetyError
from twin.service.evidence import LATE, Actuator, Evidence, body_evidence, own_evidence, own_stream
from twin.service.push import lever, limit, own_gain
from twin.service.session import MOVE, POSITION, Session
from twin.service.stages import in_mm, tolerance
from twin.signals import Command

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
        found: list[Evidence] = []
        for number in range(_ROUNDS):
            lasts = max(min(seconds * 2**number, _LONGEST), seconds)
            begun = self._session.now
            for part in self._profile(stream, column, size):
                command = {key: value.copy() for key, value in self._rest.items()}
                command[stream][0, column] += part * size
                self._hold(command, lasts, (stream, column))
            found = self._session.meanwhile(partial(self._found, begun), self._rest)
            if all(each.share.seen or each.share.deviation > _HOPELESS for each in found):
                break
        for each in found:
            if each.refused:
                self._refuse(name, f"{each.words()}; {each.refused}")
        lines = [each.words() for each in found]
        if not self._free:
            lines.append(f"{self._untold} whether it turns the body the right way")
        return f"first use of {name}: " + "; ".join(lines)

    @property
    def _untold(self) -> str:
        held = not self._session.bench.guard.floating
        return "while it is captured nothing shows" if held else "no sensor shows"

    def _tells(self, stream: str, column: int) -> bool:
        """Something will show what it does."""
        if own_stream(stream) in self._platform.sensors:
            return True
        times = np.array([self._session.now])
        readings = self._session.readings
        return self._free and lever(self._platform, readings, times, stream, column) is not None

    def _found(self, begun: float, session: Session) -> list[Evidence]:
        """All that tells of the last of those that have pushed."""
        body = body_evidence(session, self._pushed, begun) if self._free else None
        own = own_evidence(session, *self._pushed[-1])
        return [each for each in (body, own) if each is not None]

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
        sensor = platform.sensors.get(own_stream(stream))
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
