"""Stamps in ms, us or ticks that were read as seconds: the stream lasts far too long."""

from collections.abc import Iterator, Mapping

import numpy as np

from twin.conventions.correction import Correction
from twin.errors import UsageError
from twin.platform import Platform
from twin.recording import Recording

UNITS = {-3: "ms", -6: "us", -9: "ns", 3: "s", 6: "s"}
"""Power of ten by which stamps must be multiplied -> what they are in. The last two were stated to
be in ms or us."""
OFF = 0.15
"""Of a decade: how far from a thousand the ratio may be, for streams that did not run all along."""
TICKS = (1e-1, 1e-2, 1e-4, 1e-5, 1e-7, 1e-8, 1.0 / 32768.0, 60.0, 3600.0, 86400.0)
"""Seconds of one count of clocks that count in no power of a thousand: tenths, 0.1 ms, 100 ns, a
watch's crystal, minutes, hours, days."""
PLAUSIBLE = (0.5, 2e4)
"""Rates of a sensor's log [Hz]."""


def time_unit_changes(recording: Recording, platform: Platform | None) -> list[Correction]:
    """Streams whose stamps are off by a power of a thousand from the others', or from the rates
    that the platform states."""
    spans = {
        name: float(series.time[-1] - series.time[0])
        for name, series in recording.items()
        if len(series) > 1 and series.time[-1] > series.time[0]
    }
    if not spans:
        return []
    wrong: dict[str, int | None] = {name: power for name, power in _stretched(spans) if power}
    expected = {name: _expected_power(recording, platform, name) for name in spans}
    known = {power for power in expected.values() if power is not None}
    if not wrong and (tick := _tick(_ratios(recording, platform))) is not None:
        return [_counts(name, tick) for name in spans]
    if not wrong and len(known) == 1 and max(known) < 0:
        # all of them may be off alike: forgotten, not stated in vain
        wrong = dict.fromkeys(spans, known.pop())
    elif 2 * len(wrong) >= len(spans):
        # no majority: what a sensor's rate should be decides
        wrong = expected
    return [
        Correction(
            name,
            "time_unit",
            f"the times of {name} look like {UNITS[power]}, read as "
            f"{'s' if power < 0 else 'ms' if power == 3 else 'us'}",
            (("time_unit", UNITS[power]),),
            time_factor=10.0**power,
        )
        for name, power in wrong.items()
        if power
    ]


def check_times(recording: Recording, platform: Platform) -> None:
    """Whether times can be in seconds, before anything is made of their differences.

    Raises:
        UsageError: they look like another unit of time.
    """
    changes = time_unit_changes(recording, platform)
    wrong = [
        change
        for change in changes
        if change.time_factor < 1.0 or "time_scale" in dict(change.keys)
    ]
    if wrong:
        ((key, text),) = wrong[0].keys
        value = text if key == "time_scale" else f'"{text}"'
        raise UsageError(
            f"{recording.source}: {wrong[0].words}; write {key} = {value} under it in log.toml "
            "(`twin show` says it of each stream)"
        )


def _ratios(recording: Recording, platform: Platform | None) -> Mapping[str, float]:
    """By what the rate of each sensor is lower than the platform states it; nothing where some
    rate is one that a log may have, of every tenth sample, say."""
    sensors = {} if platform is None else platform.sensors
    rates = {name: recording[name].rate for name in sensors if name in recording}
    if any(PLAUSIBLE[0] <= rate <= PLAUSIBLE[1] for rate in rates.values()):
        return {}
    return {name: sensors[name].rate / rate for name, rate in rates.items() if rate > 0.0}


def _tick(ratios: Mapping[str, float]) -> float | None:
    """The seconds of one count by which all sensors are slow alike; None where they are not, or by
    a power of a thousand, which is a unit."""
    decades = np.log10(list(ratios.values())) if ratios else np.zeros(0)
    if not len(decades) or np.ptp(decades) > OFF:
        return None
    middle = float(np.median(decades))
    if _power(-middle):
        return None
    near = [tick for tick in TICKS if abs(np.log10(tick) + middle) < OFF]
    return min(near, key=lambda tick: abs(np.log10(tick) + middle)) if near else 10.0**-middle


def _counts(name: str, tick: float) -> Correction:
    size = f"{tick:.6g}"
    return Correction(
        name,
        "time_unit",
        f"the times of {name} look like counts of {size} s, read as s",
        (("time_scale", size),),
        time_factor=tick,
    )


def _stretched(spans: dict[str, float]) -> Iterator[tuple[str, int]]:
    """Each stream with the power of ten by which it must be multiplied to last as the most do."""
    lengths = np.log10(list(spans.values()))
    agreeing = [np.sum(np.abs(lengths - length) < OFF) for length in lengths]
    usual = lengths[int(np.argmax(agreeing))]
    for name, length in zip(spans, lengths, strict=True):
        yield name, _power(usual - length)


def _expected_power(recording: Recording, platform: Platform | None, name: str) -> int | None:
    """What a stream's rate says; None where it may be one or another."""
    rate = recording[name].rate
    if platform is not None and name in platform.sensors:
        return _power(np.log10(rate / platform.sensors[name].rate))
    if PLAUSIBLE[0] <= rate <= PLAUSIBLE[1]:
        return 0
    fitting = [p for p in UNITS if PLAUSIBLE[0] <= rate * 10.0**-p <= PLAUSIBLE[1]]
    return fitting[0] if len(fitting) == 1 else None


def _power(decades: float) -> int:
    """The power of a thousand that a number of decades is nearly; 0 for none."""
    power = 3 * round(decades / 3.0)
    return power if power in UNITS and abs(decades - power) < OFF else 0
