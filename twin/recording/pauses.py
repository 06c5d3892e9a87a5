"""A log in which nothing shows the motion for a while is several logs.

What the machine did meanwhile nobody knows.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.recording import Recording, Series
from twin.signals import OF_MOTION

PAUSE = 5.0
"""Without a sample of the motion that parts a log [s]; shorter ones are predicted through."""
RARE = 20.0
"""Usual intervals of what shows the motion that a pause lasts at least."""
FOLLOWED = 1.0
"""By which a stage or a gimbal is behind its command at most [s]."""
SHORTEST = 5.0
"""Of what is a log of its own [s]."""
LONG = 1800.0
"""A pause of all streams that no grid of samples is laid over [s]: two sessions in one file, or
stamps from before a clock was set."""
LEFT = 60.0
"""Of such a pause that stays [s]."""


def without_long_pauses(
    streams: Mapping[str, Series], whole: Mapping[str, Series] | None = None
) -> tuple[dict[str, Series], tuple[str, ...]]:
    """Streams whose rows after a long pause of all of them follow soon, and a sentence for each.

    Args:
        streams: of a log.
        whole: the log of which they are a part, and that has the pauses.
    """
    whole = streams if whole is None else whole
    if not _may_pause(whole):
        return dict(streams), ()
    time = np.unique(np.concatenate([series.time for series in whole.values()]))
    interval = np.diff(time)
    usual = float(np.median(interval)) if len(interval) else 0.0
    pauses = np.flatnonzero(interval > max(LONG, RARE * usual))
    if not len(pauses):
        return dict(streams), ()
    after, cut = time[pauses + 1], np.cumsum(interval[pauses] - LEFT)
    taken_off = np.concatenate([[0.0], cut])
    shorter = {
        name: replace(series, time=series.time - taken_off[_passed(after, series.time)])
        for name, series in streams.items()
    }
    said = tuple(
        f"no stream has a row from {time[i]:.6g} to {time[i + 1]:.6g} s: times after that are "
        f"{off:.9g} s less here"
        for i, off in zip(pauses, cut, strict=True)
    )
    return shorter, said


def _may_pause(streams: Mapping[str, Series]) -> bool:
    """Whether a pause of all streams as long as that can be: a stream has one, or the next begins
    that late. It needs no times of all streams in one array, which may be large."""
    stop = -np.inf
    for series in sorted(streams.values(), key=lambda series: series.time[0]):
        if LONG < series.time[0] - stop < np.inf:
            return True
        if len(series) > 1 and float(np.diff(series.time).max()) > LONG:
            return True
        stop = max(stop, float(series.time[-1]))
    return False


def _passed(after: NDArray[np.float64], time: NDArray[np.float64]) -> NDArray[np.intp]:
    """How many pauses were over at each time."""
    return np.searchsorted(after, time, side="right")


def pieces_of(recording: Recording) -> list[Recording]:
    """A log's parts between its pauses, `repairs` of the first saying so; itself where there is
    none.

    What was commanded before a part still holds at its start.
    """
    shown = [recording[name].time for name in OF_MOTION if name in recording]
    time = np.unique(np.concatenate(shown)) if shown else np.zeros(0)
    interval = np.diff(time)
    usual = min((float(np.median(np.diff(item))) for item in shown if len(item) > 1), default=0.0)
    pauses = np.flatnonzero(interval > max(PAUSE, RARE * usual))
    if not len(pauses):
        return [recording]
    starts, stops = time[np.r_[0, pauses + 1]], time[np.r_[pauses, -1]]
    spans = [
        (float(start), float(stop))
        for start, stop in zip(starts, stops, strict=True)
        if stop - start >= SHORTEST
    ]
    if not spans:
        return [recording]
    first, *others = (part_of(recording, *span) for span in spans)
    longest = int(pauses[np.argmax(interval[pauses])])
    sentence = (
        f"{recording.source}: nothing shows the motion from {time[longest]:.6g} to "
        f"{time[longest + 1]:.6g} s: it is taken as {_counted(len(spans))}"
    )
    left_out = len(starts) - len(spans)
    if left_out:
        sentence += f", and {_counted(left_out)} shorter than {SHORTEST:g} s left out"
    first = replace(first, repairs=(*recording.repairs, sentence))
    return [first, *(replace(other, repairs=()) for other in others)]


def longest_of(recording: Recording) -> Recording:
    """The longest of a log's parts between its pauses; `repairs` says so, where there are any."""
    pieces = pieces_of(recording)
    if len(pieces) == 1:
        return pieces[0]
    longest = max(pieces, key=lambda piece: piece.stop - piece.start)
    sentence = f"{pieces[0].repairs[-1]}, of which the longest is looked at"
    return replace(longest, repairs=(*recording.repairs, sentence))


def part_of(recording: Recording, start: float, stop: float) -> Recording:
    """What was measured from start to stop [s], and what was commanded by then."""
    streams = {
        name: (_held if name.startswith("command_") else _cut)(series, start, stop)
        for name, series in recording.items()
    }
    source = f"{recording.source}, {start:.6g} to {stop:.6g} s"
    return replace(
        recording,
        streams={name: series for name, series in streams.items() if len(series)},
        provenance={**recording.provenance, "source": source},
    )


def restricted(
    recording: Recording,
    *,
    start: float | None,
    stop: float | None,
    rate: float | None,
    reach: tuple[float, float] | None = None,
) -> Recording:
    """A log from `start` to `stop` [s], its measured streams no faster than `rate` [Hz]; `repairs`
    says so.

    Args:
        recording: the log, or what of it was read.
        start: of the part.
        stop: of the part.
        rate: at most.
        reach: from when to when the log is [s], where it was not read whole.

    Raises:
        LogError: nothing is between.
    """
    if start is not None or stop is not None:
        begins, ends = reach or (recording.start, recording.stop)
        first = begins if start is None else max(start, begins)
        last = ends if stop is None else min(stop, ends)
        whole = f"{begins:.6g} to {ends:.6g} s"
        part = part_of(recording, first, last) if first < last else None
        if part is None or not part.streams:
            raise LogError(
                recording.source, f"has nothing from {first:g} to {last:g} s", f"it has {whole}"
            )
        said = f"read from {first:.6g} to {last:.6g} s of {whole}"
        provenance = {**part.provenance, "source": recording.source}
        recording = replace(part, provenance=provenance, repairs=(*recording.repairs, said))
    if rate is None:
        return recording
    streams = dict(recording.streams)
    thinned = list[str]()
    for name, series in recording.items():
        step = round(series.rate / rate) if np.isfinite(series.rate) else 1
        if step > 1 and not name.startswith(("command_", "wanted_")):
            streams[name] = replace(series, time=series.time[::step], value=series.value[::step])
            thinned.append(f"{name} every {step} rows")
    if not thinned:
        return recording
    said = f"read at {rate:g} Hz at most: {', '.join(thinned)}"
    return replace(recording, streams=streams, repairs=(*recording.repairs, said))


def _cut(series: Series, start: float, stop: float) -> Series:
    return series.between(start, float(np.nextafter(stop, np.inf)))


def _held(series: Series, start: float, stop: float) -> Series:
    """Commands, with those that what they move was still following at the start.

    Of older ones the last holds until the next, as if given anew, of those that come by a clock a
    whole number of intervals before that: drives heed commands at ticks of their own.
    """
    within = _cut(series, start - FOLLOWED, stop)
    if not len(series) or series.time[0] >= start or (len(within) and within.time[0] <= start):
        return within
    interval = float(np.median(np.diff(series.time))) if len(series) > 1 else 0.0
    given = start
    if len(within) and 0.0 < interval <= FOLLOWED:
        given = float(within.time[0])
        given -= float(np.ceil((given - start) / interval)) * interval
    return replace(
        within,
        time=np.r_[given, within.time],
        value=np.concatenate([series.held_at(np.array([start])), within.value]),
    )


def _counted(logs: int) -> str:
    return "one log" if logs == 1 else f"{logs} logs"
