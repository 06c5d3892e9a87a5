"""The radio between machines of one run: what each sends, when it comes, and what is lost.

A message holds the sender's estimate and what its law adds. It leaves at the first tick of the
sender at or after k / rate, arrives `delay` later, and is lost for each receiver by chance. All
machines keep one clock, so that the time of a message is known to the receiver.
"""

import math
import zlib
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from twin.errors import UnknownName, UsageError
from twin.rotation import conjugate, multiply, rotate
from twin.signals import TOWARDS, Estimate, Received, Samples

Array = NDArray[np.float64]

_EPS = 1e-9
"""By which a tick may be early [s]: it is a product, and 3 * 0.1 is larger than 0.3."""
_DRAWN_AHEAD = 256
"""Messages whose loss is drawn at once."""


@dataclass(frozen=True)
class Radio:
    """What a link carries. By default all that is estimated, at each tick, without delay."""

    delay: float = 0.0
    """From the tick of the sender to the arrival [s]."""
    loss: float = 0.0
    """Share of messages that do not arrive, drawn for each receiver; 1: the link is cut."""
    rate: float = math.inf
    """Messages of each machine a second [Hz]; at most one at each of its ticks."""
    hears: Mapping[str, Sequence[str]] = field(default_factory=dict[str, Sequence[str]])
    """Whom a machine hears, by their names; all others unless it is named here."""

    def __post_init__(self) -> None:
        if not (math.isfinite(self.delay) and self.delay >= 0.0):
            raise UsageError(f"radio: delay is {self.delay:g} s; give 0 or more")
        if not 0.0 <= self.loss <= 1.0:
            raise UsageError(f"radio: loss is {self.loss:g}; give a share from 0 to 1")
        if not self.rate > 0.0:
            raise UsageError(f"radio: rate is {self.rate:g} Hz; give more than 0")

    def words(self) -> str:
        """What it is, for a person."""
        if self.loss == 1.0:
            return "radio cut"
        often = "each tick" if math.isinf(self.rate) else f"{self.rate:g} Hz"
        return f"radio at {often}, {self.delay:g} s late, {100.0 * self.loss:g} % lost"

    def document(self) -> dict[str, object]:
        """For JSON; a rate of null is that of the ticks."""
        rate = None if math.isinf(self.rate) else self.rate
        hears = {name: list(others) for name, others in self.hears.items()}
        return {"delay": self.delay, "loss": self.loss, "rate": rate, "hears": hears}


NUMBERS = tuple(entry.name for entry in fields(Radio) if entry.name != "hears")


def parse_radio(text: str) -> Radio:
    """`delay=0.2,loss=0.05,rate=10`, each of them optional, or `off`.

    Raises:
        UsageError: something else.
    """
    if text == "off":
        return Radio(loss=1.0)
    given: dict[str, float] = {}
    for word in text.split(","):
        name, _, number = word.partition("=")
        if name not in NUMBERS or name in given:
            raise UsageError(
                f"radio {text!r}: {word!r} is not understood; give {', '.join(NUMBERS)}, each "
                "once, as in delay=0.2,loss=0.05,rate=10, or off"
            )
        try:
            given[name] = float(number)
        except ValueError:
            raise UsageError(f"radio {text!r}: {name} is {number!r}; give a number") from None
    return replace(Radio(), **given)


class Station(NamedTuple):
    """A machine as the radio knows it."""

    name: str
    travels: bool = False
    """Whether it has a place that changes."""
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where the zero of its place is in the room that all share [m]."""


class Airwaves:
    """Messages on their way, of n runs."""

    def __init__(
        self, radio: Radio, stations: Sequence[Station], runs: Sequence[int], seed: int
    ) -> None:
        """Nothing has been sent.

        Args:
            radio: what the link carries.
            stations: all machines of the run.
            runs: the numbers of the runs; the losses of a run depend on `seed` and its number only.
            seed: of all random numbers.

        Raises:
            UnknownName: `hears` names no machine of the run.
        """
        names = [station.name for station in stations]
        for name in (*radio.hears, *(sender for heard in radio.hears.values() for sender in heard)):
            if name not in names:
                raise UnknownName("machine", name, names)
        self._radio = radio
        self._sent = dict.fromkeys(names, 0)
        self._links: dict[str, dict[str, _Link]] = {
            receiver.name: {
                sender.name: _Link(sender, receiver, radio.loss, runs, seed)
                for sender in stations
                if sender is not receiver and sender.name in radio.hears.get(receiver.name, names)
            }
            for receiver in stations
        }

    def due(self, name: str, time: float) -> bool:
        """Whether a machine sends at this tick of its own [s]."""
        if self._radio.loss == 1.0:
            return False
        return math.isinf(self._radio.rate) or time >= self._sent[name] / self._radio.rate - _EPS

    def send(self, name: str, time: float, estimate: Estimate, extra: Mapping[str, Array]) -> None:
        """A machine sends what it knows at a tick of its own [s]."""
        if math.isfinite(self._radio.rate):
            self._sent[name] = math.floor((time + _EPS) * self._radio.rate) + 1
        message = Received(
            np.where(estimate.valid, time, np.nan),
            estimate.attitude,
            estimate.rate_body,
            estimate.position,
            estimate.velocity,
            extra,
        )
        for links in self._links.values():
            if name in links:
                links[name].send(time + self._radio.delay, message)

    def received(self, name: str, time: float) -> dict[str, Received]:
        """What a machine has heard by now, the newest of each other one."""
        heard = {sender: link.newest(time) for sender, link in self._links[name].items()}
        return {sender: message for sender, message in heard.items() if message is not None}


class _Link:
    """From one machine to another."""

    def __init__(
        self, sender: Station, receiver: Station, loss: float, runs: Sequence[int], seed: int
    ) -> None:
        self._loss = loss
        self._shift = np.subtract(sender.origin, receiver.origin)
        self._places = sender.travels and receiver.travels
        key = zlib.crc32(f"{sender.name} {receiver.name}".encode())
        self._generators = [
            np.random.Generator(np.random.SFC64(np.random.SeedSequence([seed, run, key])))
            for run in runs
        ]
        self._drawn = np.zeros((len(runs), 0))
        self._under_way: deque[tuple[float, Received]] = deque()
        self._newest: Received | None = None

    def send(self, arrival: float, message: Received) -> None:
        """Let a message arrive [s], where it is not lost."""
        if self._loss > 0.0:
            arrives = self._draw() >= self._loss
            message = replace(message, time=np.where(arrives, message.time, np.nan))
        place, velocity = message.position, message.velocity
        if not self._places or place is None:
            place = velocity = None
        else:
            place = place + self._shift
        self._under_way.append((arrival, replace(message, position=place, velocity=velocity)))

    def newest(self, time: float) -> Received | None:
        """The newest message that has come by now [s] in each run; None before the first."""
        while self._under_way and self._under_way[0][0] <= time + _EPS:
            message = self._under_way.popleft()[1]
            if message.valid.all():
                self._newest = message
            elif message.valid.any():
                self._newest = _merged(self._newest, message)
        return self._newest

    def _draw(self) -> Array:
        if not self._drawn.shape[1]:
            self._drawn = np.stack([g.random(_DRAWN_AHEAD) for g in self._generators])
        first, self._drawn = self._drawn[:, 0], self._drawn[:, 1:]
        return first


def _merged(before: Received | None, message: Received) -> Received:
    """The newer message in each run that has one; rows of a run that has none are without time."""
    if before is None:
        return message
    fresh = message.valid

    def newer(old: Array | None, new: Array | None) -> Array | None:
        if old is None or new is None:
            return new
        return np.where(fresh[:, None], new, old)

    return Received(
        np.where(fresh, message.time, before.time),
        np.where(fresh[:, None], message.attitude, before.attitude),
        np.where(fresh[:, None], message.rate_body, before.rate_body),
        newer(before.position, message.position),
        newer(before.velocity, message.velocity),
        {
            key: np.where(fresh[:, None], value, before.extra.get(key, value))
            for key, value in message.extra.items()
        },
    )


def relative_attitude(attitude: Array, other: Array) -> Array:
    """q_ij = q_j^* q_i of attitudes (n, 4): vectors of body i in the axes of body j."""
    return multiply(conjugate(other), attitude)


def relative_rate(relative: Array, rate: Array, other: Array) -> Array:
    """w_ij = w_i - R(q_ij)^T w_j of rates (n, 3) [rad/s], in the axes of body i."""
    return rate - rotate(conjugate(relative), other)


def as_estimated(estimate: Estimate) -> dict[str, Samples]:
    """Streams of a machine relative to each one that it has heard, as it knows them.

    It holds itself now against the newest message as it came: `relative_age` is how old that is.
    """
    streams: dict[str, Samples] = {}
    n = len(estimate.valid)
    stamp = np.full((n, 1), estimate.time)
    for name, other in estimate.received.items():
        valid = (estimate.valid & other.valid)[:, None]
        turn = relative_attitude(estimate.attitude, other.attitude)
        values = {
            "relative_attitude": turn,
            "relative_rate": relative_rate(turn, estimate.rate_body, other.rate_body),
            "relative_age": (estimate.time - other.time)[:, None],
        }
        if estimate.position is not None and other.position is not None:
            values["relative_position"] = estimate.position - other.position
        if estimate.velocity is not None and other.velocity is not None:
            values["relative_velocity"] = estimate.velocity - other.velocity
        for stream, value in values.items():
            known = valid & np.isfinite(value).all(axis=1, keepdims=True)
            streams[f"{stream}{TOWARDS}{name}"] = Samples(value[:, None], stamp, known)
    return streams


def as_true(
    station: Station,
    truth: Mapping[str, Samples],
    others: Mapping[Station, Mapping[str, Samples]],
) -> dict[str, Samples]:
    """Streams of a simulated machine relative to each other one, of true states at one time."""
    streams: dict[str, Samples] = {}
    attitude, rate = truth.get("truth_attitude"), truth.get("truth_rate")
    for other, states in others.items():
        end = f"{TOWARDS}{other.name}"
        theirs = states.get("truth_attitude"), states.get("truth_rate")
        if attitude is None or rate is None or theirs[0] is None or theirs[1] is None:
            continue  # it hangs on a hinge
        valid = attitude.valid & theirs[0].valid
        turn = relative_attitude(attitude.value[:, 0], theirs[0].value[:, 0])
        turning = relative_rate(turn, rate.value[:, 0], theirs[1].value[:, 0])
        values = {"truth_relative_attitude": turn, "truth_relative_rate": turning}
        if station.travels and other.travels:
            shift = np.subtract(station.origin, other.origin)
            mine, other_place = truth["truth_position"], states["truth_position"]
            values["truth_relative_position"] = (mine.value - other_place.value)[:, 0] + shift
            speeds = truth["truth_velocity"].value - states["truth_velocity"].value
            values["truth_relative_velocity"] = speeds[:, 0]
        for stream, value in values.items():
            streams[stream + end] = Samples(value[:, None], attitude.time, valid)
    return streams
