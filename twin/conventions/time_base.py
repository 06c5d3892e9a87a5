"""Stamps in ms or us that were read as seconds: the stream lasts a thousand times too long."""

from collections.abc import Iterator

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
    wrong = [one for one in time_unit_changes(recording, platform) if one.time_factor < 1.0]
    if wrong:
        unit = dict(wrong[0].keys)["time_unit"]
        raise UsageError(
            f'{recording.source}: {wrong[0].words}; write time_unit = "{unit}" under it in '
            "log.toml (`twin show` says it of each stream)"
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
