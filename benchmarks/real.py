"""Faults put into the real logs that we ship, and what is named: `python -m benchmarks real`.

A fault of a sensor, of a unit or of a clock can be put into a real log exactly, whatever else the
log contains, so that its name and size are known. Each case asks the verb that a lab would ask:

- `sensors`: errors of a gyro or of the attitude beside it (`twin compare` without a platform), at
  three sizes, either sign, each axis;
- `units`: a stream in another unit or with the other sign (`twin show`);
- `clocks`: a stream that is late (`twin diagnose`).

A case is *named* where the fault is said, with a size whose 95 % interval contains the one put in;
*wrong* where something is said as sure that neither the log nor the fault contains.
"""

import argparse
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import twin
from benchmarks.measure import table
from twin import rotation
from twin.conventions import ConventionFinding, check_conventions
from twin.conventions.joint import rate_lag
from twin.diagnosis import diagnose
from twin.errors import TwinError
from twin.predict.logs import ImpossibleLog, check_possible
from twin.processes import Pool
from twin.recording import Recording, Series
from twin.strapdown.compare import NAMES, GyroComparison

Array = NDArray[np.float64]

MODELS = Path(__file__).parents[1] / "models"
SENSORS = ("broad_imu/logs/slow_rotation",)
UNITS = {
    "dfki_pendulum/logs/energy_shaping": ("joint_angle", "joint_rate"),
    "dfki_pendulum/logs/energy_shaping_1kg": ("joint_angle", "joint_rate"),
    "dfki_pendulum/logs/sysid": ("joint_angle", "joint_rate"),
    "kentucky_planar/logs/mission": ("position",),
    "kentucky_planar/logs/simulated_mission": ("position",),
    "vnucec_cubesat/logs/steps": ("joint_rate",),
    "broad_imu/logs/slow_rotation": ("gyro", "accelerometer"),
}
"""Streams that another one of the log, or what the machine is commanded, can be held against."""
FACTORS = {
    "joint_angle": (180.0 / np.pi, -1.0),
    "joint_rate": (180.0 / np.pi, 60.0 / (2.0 * np.pi), -1.0),
    "gyro": (180.0 / np.pi, 1e3, -1.0),
    "accelerometer": (1.0 / 9.80665, 1e3, 1e3 / 9.80665, -1.0),
    "position": (1e3, 1e2, -1.0),
}
"""By which a stream is read wrongly: degrees, rpm, milli, g, the other sign."""
CLOCKS = {
    "dfki_pendulum/logs/energy_shaping": ("joint_angle", "joint_rate"),
    "dfki_pendulum/logs/energy_shaping_1kg": ("joint_angle", "joint_rate"),
    "dfki_pendulum/logs/sysid": ("joint_angle", "joint_rate"),
}
LATE = (0.02, 0.05, 0.1)
"""By which a stream is late [s]."""
SIZES = {
    "gyro_bias": np.radians([0.1, 0.5, 2.0]),
    "gyro_scale_factor": np.array([0.005, 0.02, 0.1]),
    "gyro_misalignment": np.radians([0.3, 1.0, 5.0]),
    "clock_lag": np.array([0.002, 0.01, 0.05]),
}
"""Of each error of a gyro, SI."""


@dataclass(frozen=True)
class Case:
    """One fault in one log."""

    kind: str
    """`sensors`, `units` or `clocks`."""
    log: str
    stream: str
    fault: str
    column: int
    """Axis of a vector; 0 of others."""
    size: float

    @property
    def words(self) -> str:
        """For the table of misses."""
        return f"{self.log}: {self.stream}, {self.fault} {'xyz'[self.column]} {self.size:.4g}"


@dataclass(frozen=True)
class Outcome:
    """What was said of a case."""

    case: Case
    named: bool
    wrong: tuple[str, ...]
    seconds: float
    said: str


def cases() -> Iterator[Case]:
    """All of them, the quick ones first."""
    for log, streams in UNITS.items():
        for stream in streams:
            for factor in FACTORS[stream]:
                yield Case("units", log, stream, "factor", 0, factor)
    for log in SENSORS:
        for fault, sizes in SIZES.items():
            streams = ("gyro",) if fault in ("gyro_bias", "gyro_scale_factor") else _PAIR
            for stream in streams:
                for column in range(1 if fault == "clock_lag" else 3):
                    for size in (*sizes, *-sizes):
                        yield Case("sensors", log, stream, fault, column, float(size))
    for log, streams in CLOCKS.items():
        for stream in streams:
            for late in LATE:
                yield Case("clocks", log, stream, f"clock_lag:{stream}", 0, late)


_PAIR = ("gyro", "attitude")


def faulty(log: Recording, case: Case) -> Recording:
    """The log with the fault."""
    series = log[case.stream]
    value, time_ = series.value, series.time
    unit = np.eye(3)[case.column]
    if case.fault == "factor":
        value = case.size * value
    elif case.fault.startswith("clock_lag"):
        time_ = time_ + case.size
    elif case.fault == "gyro_bias":
        value = value + case.size * unit
    elif case.fault == "gyro_scale_factor":
        value = value * (1.0 + case.size * unit)
    elif case.stream == "gyro":
        value = value @ rotation.matrix(rotation.from_rotation_vector(case.size * unit))
    else:
        value = rotation.multiply(value, rotation.from_rotation_vector(-case.size * unit))
    return replace(log, streams={**log.streams, case.stream: _changed(series, time_, value)})


def _changed(series: Series, time_: Array, value: Array) -> Series:
    return replace(series, time=time_, value=value)


@cache
def _log(name: str) -> Recording:
    return twin.read(MODELS / name).without_truth()


@cache
def _raw_comparison(name: str) -> GyroComparison:
    return twin.compare_sensors(_log(name))


@cache
def _raw_streams(name: str) -> frozenset[str]:
    return frozenset(finding.stream for finding in _findings(_log(name)))


@cache
def _raw_causes(name: str) -> frozenset[str]:
    found = diagnose([_log(name)], twin.machine_of(_log(name)))
    return frozenset(cause.effect.name for cause in found.causes)


def _findings(log: Recording) -> list[ConventionFinding]:
    machine = twin.machine_of(log) if log.provenance.get("platform") else None
    return check_conventions(log, machine)


def outcome(case: Case) -> Outcome:
    """What is said of a log with the fault, held against what is said of it without."""
    begin = time.perf_counter()
    ask = {"units": _of_units, "sensors": _of_sensors, "clocks": _of_clocks}[case.kind]
    try:
        named, wrong, said = ask(case, faulty(_log(case.log), case))
    except TwinError as why:
        named, wrong, said = False, (), f"refused: {why}"
    return Outcome(case, named, wrong, time.perf_counter() - begin, said)


Said = tuple[bool, tuple[str, ...], str]
"""Whether the fault is named, what is wrong and sure, in words."""


def _of_units(case: Case, log: Recording) -> Said:
    findings = _findings(log)
    try:
        if log.provenance.get("platform"):
            check_possible(log, twin.machine_of(log))
        named, refusal = False, ""
    except ImpossibleLog as why:
        refusal = str(why)
        named = f"{case.stream} shows" in refusal and case.size > 0.0
    for finding in findings:
        for item in finding.corrections:
            if case.size < 0.0:
                turned = item.factor < 0.0 or (bool(item.axes) and np.linalg.det(item.axes) < 0.0)
                right = turned or item.kind in ("axes", "direction")
            else:
                right = abs(np.log(abs(item.factor * case.size))) < SAME
            named |= item.stream == case.stream and right
        # of two streams that disagree, the log may not say which is wrong
        named |= any(case.stream in words for words in finding.alternatives)
    known = {case.stream, *_raw_streams(case.log)}
    wrong = tuple(
        finding.sentence
        for finding in findings
        if not finding.ambiguous and finding.stream not in known
    )
    said = [*(finding.sentence for finding in findings), refusal]
    return named, wrong, " ".join(filter(None, said))


def _of_sensors(case: Case, log: Recording) -> Said:
    raw, result = _raw_comparison(case.log), twin.compare_sensors(log)
    expected = np.zeros(len(NAMES))
    first = [fault.name for fault, _ in NAMES].index(case.fault)
    # a late gyro is an early attitude; turns of the two are written alike
    against = -1.0 if case.stream == "attitude" and case.fault == "clock_lag" else 1.0
    expected[first + case.column] = against * case.size
    # what the fault does to the bias that the gyro has
    bias = Series(np.zeros(1), raw.value[None, :3], ("x", "y", "z"), "rad/s")
    if case.stream == "gyro" and case.fault != "clock_lag":
        shown_bias = faulty(replace(log, streams={"gyro": bias}), case)["gyro"].value[0]
        expected[:3] = shown_bias - bias.value[0]
    change = result.value - raw.value
    wide = result.half_width + raw.half_width
    off = np.abs(change - expected) > wide
    place = first + case.column
    shown = bool(result.certain[place]) or abs(case.size) < result.half_width[place]
    others = [i for i in np.flatnonzero(off & result.certain) if i != place]
    wrong = tuple(f"{NAMES[i][0].name} {NAMES[i][1]} {change[i]:.3g}" for i in others)
    return bool(shown and not off[place]), wrong, f"{change[place]:.4g} +- {wide[place]:.2g}"


def _of_clocks(case: Case, log: Recording) -> Said:
    result = diagnose([log], twin.machine_of(_log(case.log)))
    sizes = {cause.effect.label: cause for cause in result.causes}
    # a late rate is an early angle, and the log has a lag of its own
    raw = rate_lag(_log(case.log)) or (0.0, 0.0)
    lag = raw[0] + (case.size if case.stream == "joint_rate" else -case.size)
    right = False
    for stream, expected in (("joint_rate", lag), ("joint_angle", -lag)):
        cause = sizes.get(f"clock_lag:{stream}")
        if cause is not None:
            wide = float(cause.half_widths[0]) + raw[1]
            right |= bool(abs(cause.effect.values[0] - expected) < wide)
    known = {"clock_lag", *_raw_causes(case.log)}
    wrong = tuple(
        label
        for label, item in sizes.items()
        if item.effect.name not in known and item.confidence > SURE and result.intervals_hold
    )
    return right, wrong, f"{result.verdict}: {', '.join(sizes) or 'nothing'}"


SAME = 0.05
"""Of the logarithm of a factor."""
SURE = 0.9
"""Confidence from which a wrong name counts as sure."""


def run(options: Sequence[str] = ()) -> None:
    """Print a row a kind, and the misses."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks real")
    parser.add_argument("--kinds", nargs="+", default=["units", "sensors", "clocks"])
    parser.add_argument("--jobs", type=int, default=2)
    asked = parser.parse_args(options)
    outcomes: list[Outcome] = []
    with Pool(asked.jobs) as pool:
        waiting = [pool.submit(outcome, case) for case in cases() if case.kind in asked.kinds]
        for done in as_completed(waiting):
            outcomes.append(done.result())
            if not outcomes[-1].named or outcomes[-1].wrong:
                item = outcomes[-1]
                word = "wrong" if item.wrong else "missed"
                print(f"{word}: {item.case.words}: {item.said} {'; '.join(item.wrong)}", flush=True)
    rows = []
    for kind, log in sorted({(item.case.kind, item.case.log) for item in outcomes}):
        these = [o for o in outcomes if (o.case.kind, o.case.log) == (kind, log)]
        rows.append(_row(kind, log, these))
    rows.append(_row("all", "", outcomes))
    table(("fault", "log", "cases", "named", "wrong and sure", "median [s]"), rows)


def _row(kind: str, log: str, these: Sequence[Outcome]) -> tuple[str, ...]:
    counts = Counter(named=sum(o.named for o in these), wrong=sum(bool(o.wrong) for o in these))
    seconds = float(np.median([o.seconds for o in these]))
    named = f"{counts['named']} ({counts['named'] / len(these):.0%})"
    return kind, log, str(len(these)), named, str(counts["wrong"]), f"{seconds:.1f}"
