"""What all runs of a batch measured since a time, kept while their phases need it."""

from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.procedures.fits import Fits
from twin.procedures.plan import Notes
from twin.recording import Recording, Series
from twin.signals import Mask, Tick, stream_named

Array = NDArray[np.float64]


Number = TypeVar("Number", bound=np.generic)

ROOM = 256
"""Rows at first."""


class Kept:
    """Rows of one stream; grows as needed, and drops rows that are no longer needed."""

    def __init__(self, runs: int, width: int) -> None:
        self._time = np.empty((runs, ROOM))
        self._value = np.empty((runs, ROOM, width))
        self._valid = np.empty((runs, ROOM), dtype=np.bool_)
        self._count = 0

    def add(self, time: Array, value: Array, valid: Mask, since: float) -> None:
        """Rows of all runs.

        Args:
            time: (n or 1, m) [s].
            value: (n or 1, m, k).
            valid: (n or 1, m), False where a run has no such row.
            since: older rows are no longer needed [s].
        """
        if self._count + value.shape[1] > self._time.shape[1]:
            self._make_room(value.shape[1], since)
        new = slice(self._count, self._count + value.shape[1])
        self._time[:, new], self._value[:, new], self._valid[:, new] = time, value, valid
        self._count = new.stop

    def rows(self, run: int, start: float) -> tuple[Array, Array]:
        """Times (m,) and values (m, k) of a run from a time on [s], in the order of the times."""
        time, value = self._time[run, : self._count], self._value[run, : self._count]
        rows = np.flatnonzero(self._valid[run, : self._count] & (time >= start))
        rows = rows[np.argsort(time[rows], kind="stable")]
        return time[rows], value[rows]

    def _make_room(self, more: int, since: float) -> None:
        recent = (self._time[:, : self._count] >= since).any(axis=0)
        first = int(np.argmax(recent)) if recent.any() else self._count
        live = slice(first, self._count)
        self._count -= first
        room = max(self._time.shape[1], 2 * (self._count + more))
        self._time = _moved(self._time, live, room)
        self._value = _moved(self._value, live, room)
        self._valid = _moved(self._valid, live, room)


def _moved(rows: NDArray[Number], live: slice, room: int) -> NDArray[Number]:
    """Those that live, at the front of so much room."""
    result = np.empty((len(rows), room, *rows.shape[2:]), dtype=rows.dtype)
    result[:, : live.stop - live.start] = rows[:, live]
    return result


FITTED = {
    "gyro",
    "attitude",
    "inclinometer",
    "accelerometer",
    "wheel_speed",
    "gimbal_angle",
    "gimbal_rate",
    "stage_position",
    "command_wheel_torque",
    "command_gimbal_rate",
    "command_stage_position",
    "command_dipole",
    "estimate_gyro_bias",
}
"""What an offset is identified from. Not a magnetometer beside coils; beside an attitude neither an
accelerometer nor an inclinometer, and no accelerometer beside an inclinometer."""


class Logbook:
    """Observer of a loop: remembers its ticks from `forget`'s time on, what of them is fitted."""

    def __init__(self, platform: Platform) -> None:
        self._platform = platform
        self._kept: dict[str, Kept] = {}
        self._since = np.inf
        better = {"attitude", "inclinometer"} & platform.sensors.keys()
        self._names = FITTED - ({"accelerometer"} if better else set[str]())

    def collect(self, tick: Tick) -> None:
        """One tick."""
        time = tick.reading.time
        if time < self._since:
            return
        valid = tick.estimate.valid
        for name, samples in tick.reading.streams.items():
            self._keep(name, len(valid), samples.time, samples.value, samples.valid)
        stamp, every = np.full((1, 1), time), np.ones((1, 1), dtype=np.bool_)
        for name, value in tick.applied.items():
            self._keep(name, len(valid), stamp, value[:, None], every)
        bias = tick.estimate.gyro_bias[:, None]
        self._keep("estimate_gyro_bias", len(valid), stamp, bias, valid[:, None])

    def forget(self, before: float) -> None:
        """Rows before that time are no longer needed [s]; inf: none are."""
        self._since = before
        if before == np.inf:
            self._kept.clear()

    def recording(self, run: int, start: float) -> Recording:
        """Measurements and commands of a run since `start` [s]."""
        streams: dict[str, Series] = {}
        for name, kept in self._kept.items():
            # Samples from before the start may arrive after it: under another command.
            time, value = kept.rows(run, start)
            if len(time):
                columns, unit = self._platform.columns(name), stream_named(name).unit
                streams[name] = Series(time, value, columns, unit)
        if "attitude" in streams:
            streams.pop("inclinometer", None)
        facts = {"platform": self._platform.name, "source": f"balancing, from {start:.2f} s on"}
        return _still(Recording(streams, facts), self._platform)

    def _keep(self, name: str, runs: int, time: Array, value: Array, valid: Mask) -> None:
        if name not in self._names:
            return
        if name not in self._kept:
            self._kept[name] = Kept(runs, value.shape[-1])
        self._kept[name].add(time, value, valid, self._since)


def _still(recording: Recording, platform: Platform) -> Recording:
    """With masses that stand where they mostly are: they hold while a phase is recorded.

    A counter whose mass stands between two of its digits shows now one and now the other; a fit
    would take that for motion.
    """
    if "stage_position" not in recording:
        return recording
    shown = recording["stage_position"]
    digit = 1.5 * np.array([stage.resolution for stage in platform.stages])
    middle = np.median(shown.value, axis=0)
    value = np.where(np.abs(shown.value - middle) <= digit, middle, shown.value)
    return replace(
        recording, streams={**recording.streams, "stage_position": replace(shown, value=value)}
    )


@dataclass(frozen=True)
class Lab:
    """Of n runs."""

    logbook: Logbook
    """Also an observer of the loop."""
    fits: Fits
    notes: Notes
    logs: dict[int, list[Recording]] = field(default_factory=dict[int, list[Recording]])
    """Of each run: the last swing, and the free float after it once there was one."""
