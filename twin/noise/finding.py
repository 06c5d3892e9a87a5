"""What the data say of their noise, held against what the log and the platform say of it."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.noise.stream import StreamNoise, measure_noise
from twin.noise.stuck import measurements
from twin.platform import Platform
from twin.recording import Recording
from twin.signals import DERIVED, STREAMS
from twin.units import printed

Array = NDArray[np.float64]

FACTOR = 1.5
"""A stated noise further off than this is worth a sentence."""
MIN_MEASURED = 100
"""With fewer samples the estimate itself may be off by a quarter."""
UNSTEADY = 0.1
"""Jitter of more than this share of the period is worth a sentence."""
KICKED = {
    "wheel_speed": ("command_wheel_torque", "command_wheel_duty"),
    "stage_position": ("command_stage_position",),
    "gimbal_angle": ("command_gimbal_rate",),
    "gimbal_rate": ("command_gimbal_rate",),
    "inclinometer": ("command_stage_position",),
}
"""Commands that move a sensor's reading in less than a sample: under a law that answers to noise
its differences hold their kicks too, and neither more than its noise nor an outlier is a finding.
"""
SHAKEN = {"gyro": "stage_vibration"}
"""Effects of a platform that shake a sensor: it scatters by more than its own noise."""
MANY = 1e-3
"""More outliers than this share of the samples are worth a sentence."""


@dataclass(frozen=True)
class NoiseFinding:
    """One thing about a stream's noise that its reader should know."""

    stream: str
    kind: str
    """`noise`, `quantised`, `outliers`, `gaps`, `jitter` or `repeated`."""
    found: float
    """Of `noise` [SI, rms over the columns]; else the share, or the jitter [s]."""
    stated: float | None
    """What was claimed of it; None where nothing was."""
    sentence: str


def noise_findings(recording: Recording, platform: Platform | None) -> list[NoiseFinding]:
    """Measure the noise of every sensor's stream and hold it against what is stated.

    What a log states of its noise stands before what its platform states.
    """
    findings: list[NoiseFinding] = []
    for name, rows in recording.items():
        series = measurements(name, rows) if _measured(name) else rows
        if not _measured(name) or len(series) < MIN_MEASURED:
            continue
        if (series.value == series.value[0]).all():
            continue  # what stands still on its grid shows neither noise nor clock
        noise = measure_noise(series)
        unit = "rad" if name == "attitude" else recording.unit_of(name)
        grid, kicked = _grid(name, platform), _kicked(name, recording)
        shaken = kicked or _shaken(name, platform)
        claim = _claim(name, recording, platform)
        findings += _against_claims(name, unit, noise, claim, grid, shaken=shaken)
        findings += _quality(name, unit, noise, len(series), grid, kicked=kicked)
    return findings


def _measured(name: str) -> bool:
    """Whether a stream is a sensor's, not a command, a state of the software or of the truth."""
    return name in STREAMS and not name.startswith(DERIVED)


def _against_claims(
    name: str,
    unit: str,
    noise: StreamNoise,
    claimed: tuple[float, str],
    grid: float,
    *,
    shaken: bool,
) -> list[NoiseFinding]:
    claim, source = claimed
    result = _rms(noise.white)
    # a column that stands still on its grid hides its noise
    hidden = bool(noise.quantised.any()) and result <= FACTOR * _rms(noise.resolution)
    if not claim or 1.0 / FACTOR <= result / claim <= FACTOR or (hidden and result < claim):
        return []
    if result > claim and (shaken or result < grid):
        return []
    ratio = result / claim
    sentence = (
        f"The noise of {name} is {printed(result, unit)} a sample, "
        + (f"{ratio:.2g} times" if ratio > 1.0 else f"{1.0 / ratio:.2g} times less than")
        + f" the {printed(claim, unit)} that {source} states."
    )
    return [NoiseFinding(name, "noise", result, claim, sentence)]


def _kicked(name: str, recording: Recording) -> bool:
    """Whether something was told to move a sensor."""
    return any(
        np.ptp(recording[command].value, axis=0).any()
        for command in KICKED.get(name, ())
        if command in recording and len(recording[command])
    )


def _shaken(name: str, platform: Platform | None) -> bool:
    """Whether a platform states what makes a sensor scatter by more than its noise."""
    return platform is not None and any(e.name == SHAKEN.get(name) for e in platform.effects)


def _grid(name: str, platform: Platform | None) -> float:
    """Step that a platform states of a sensor; 0: none."""
    if platform is None or name not in platform.sensors:
        return 0.0
    return platform.sensors[name].resolution


def _claim(name: str, recording: Recording, platform: Platform | None) -> tuple[float, str]:
    """Stated 1 sigma a sample, rms over the columns; 0 where nothing is stated."""
    streams = cast(Mapping[str, Mapping[str, Any]], recording.provenance.get("streams") or {})
    entry = streams.get(name) or {}
    if entry.get("fit_scale"):
        return 0.0, ""  # volts against rad/s
    stated = entry.get("noise")
    if stated is not None:
        return _rms(np.asarray(stated, dtype=np.float64)), "the log"
    if platform is None or name not in platform.sensors:
        return 0.0, ""
    sensor = platform.sensors[name]
    grid = sensor.resolution * (2.0 if name == "attitude" else 1.0)
    return float(np.hypot(_rms(sensor.noise), grid / np.sqrt(12.0))), "platform.toml"


def _quality(
    name: str, unit: str, noise: StreamNoise, count: int, grid: float, *, kicked: bool
) -> list[NoiseFinding]:
    findings: list[NoiseFinding] = []

    def say(kind: str, result: float, sentence: str) -> None:
        findings.append(NoiseFinding(name, kind, result, None, sentence))

    clock, flagged = noise.clock, int(noise.outliers.sum())
    if noise.quantised.any():
        step = float(noise.resolution.max())
        say(
            "quantised",
            step,
            f"{name} comes in steps of {printed(step, unit)}, which is more than its noise: "
            f"its errors are those of the grid, {printed(step / np.sqrt(12.0), unit)} a sample.",
        )
    if flagged > max(MANY * count, 1.0) and not kicked:
        say(
            "outliers",
            flagged / count,
            f"{flagged} of {count} samples of {name} lie more than 6 sigma off their neighbours.",
        )
    if clock.gaps:
        say(
            "gaps",
            clock.lost / count,
            f"{name} has {clock.gaps} {'gap' if clock.gaps == 1 else 'gaps'} in which about "
            f"{clock.lost} samples were lost; the longest is {printed(clock.longest_gap, 's')}.",
        )
    if clock.jitter > UNSTEADY * clock.period:
        say(
            "jitter",
            clock.jitter,
            f"The stamps of {name} jitter by {printed(clock.jitter, 's')} about a period of "
            f"{printed(clock.period, 's')}.",
        )
    on_grid = bool(noise.quantised.any()) or _rms(noise.white) < grid
    if clock.repeated > 0.2 and not on_grid:
        say(
            "repeated",
            clock.repeated,
            f"{clock.repeated:.0%} of the rows of {name} repeat the one before: the sensor is "
            "slower than its log.",
        )
    return findings


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else 0.0
