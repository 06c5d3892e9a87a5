"""The contents of a log: rows, clock, gaps, ranges and noise, in words and as JSON."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.comparison.account import Account
from twin.conventions import ConventionAdvice, convention_advice
from twin.errors import TwinError, UnknownName, UsageError
from twin.noise import StreamNoise, measure_noise, noise_findings
from twin.noise.cleaning import cleaned
from twin.noise.stream import GAP, clock_of
from twin.noise.stuck import measurements
from twin.noise.tachometer import with_signs
from twin.platform import Platform, beyond_stated, check_columns, in_order_of, taken_as_at_rest
from twin.predict.logs import (
    ImpossibleLog,
    check_possible,
    check_within_stop,
    motion_of,
    no_shared_time,
    usable,
)
from twin.recording import Recording, Series
from twin.shown import Shown
from twin.signals import DERIVED, LOGGED, PREDICTED, RESIDUAL, STREAMS, stream_named
from twin.units import fitting, printed, three_digits, unit_of

Array = NDArray[np.float64]

HELD = ("command_", "wanted_")
"""Streams whose value holds until the next row begin so."""
UNCLOCKED = 0.1
"""Such a stream was written when it changed, not by a clock, if its intervals scatter by more than
this share of their median: then no row of it is missing."""

LISTED = 100
"""Gaps of a stream that the JSON document lists, the longest first."""


@dataclass(frozen=True)
class StreamContents:
    """What one stream holds."""

    name: str
    series: Series
    noise: StreamNoise
    measured: bool
    """By a sensor; else `noise` says something of its clock only."""
    gaps: tuple[tuple[float, float], ...]
    """First and last instant of the stretches without samples [s], the longest first; none where
    no clock tells when a sample is due."""
    unscaled: str
    """The SI unit that the values are still in, where their scale is to be fitted; else empty."""

    @property
    def shown(self) -> tuple[tuple[str, ...], Array, str]:
        """Columns, values (m, k) and unit as a person reads them: an attitude as Euler angles."""
        if self.series.columns == ("w", "x", "y", "z"):
            angles = np.unwrap(rotation.to_euler_zyx(self.series.value), axis=0)
            return ("yaw", "pitch", "roll"), angles, "rad"
        unit = unit_of(self.name, self.series.unit)
        return self.series.columns, self.series.value, self.unscaled or unit

    @property
    def held(self) -> bool:
        """Whether a value holds until the next row."""
        return self.name.startswith(HELD)

    @property
    def clocked(self) -> bool:
        """Whether rows came by a clock, so that one can be late or missing."""
        clock = self.noise.clock
        return not (self.held and clock.jitter > UNCLOCKED * clock.period)

    @property
    def still(self) -> bool:
        """Whether every row is the same."""
        return bool((self.series.value == self.series.value[:1]).all())


@dataclass(frozen=True)
class Contents(Shown):
    """What a log holds."""

    source: str
    """Where the log is from."""
    recording: Recording
    streams: tuple[StreamContents, ...]
    conventions: ConventionAdvice
    """Streams that look misread, and the lines of log.toml that put them right."""
    findings: tuple[str, ...]
    """Sentences: noise that is not as stated, bad clocks."""

    @property
    def misread(self) -> bool:
        """Whether a stream looks as if it had been read in a wrong convention, surely."""
        return any(not finding.ambiguous for finding in self.conventions.findings)


def contents_of(
    source: str, recording: Recording, platform: Platform | None, problem: str = ""
) -> Contents:
    """Look at every stream. Noise is held against the platform's, where one is given, and wheels
    against its body; else the `problem` says why there is none."""
    if platform is not None:
        recording = in_order_of(platform, recording)
    findings = [finding.sentence for finding in noise_findings(recording, platform)]
    if recording.provenance.get("kind") == "log":
        findings += (_unused(name) for name in recording if not _known(name))
    wheels = () if platform is None else platform.wheels
    signed, _ = with_signs(recording, [wheel.axis for wheel in wheels if wheel.gimbal is None])
    advice = convention_advice(signed, platform)
    used = cleaned(recording) if platform is None else usable(recording, platform)
    findings += (f"{repair}." for repair in used.repairs if repair not in recording.repairs)
    if platform is None:
        findings += _disjoint_streams(recording)
    else:
        findings += _of_other_width(recording, platform)
        findings += taken_as_at_rest([recording], platform)
        findings += beyond_stated([recording], platform)
        findings += _impossible(recording, platform, read_rightly=not advice.findings)
    if problem:
        findings.append(f"The log was not compared with the machine: {problem}.")
    return Contents(
        source,
        recording,
        tuple(_stream(recording, name) for name in recording),
        advice,
        tuple(findings),
    )


def _disjoint_streams(recording: Recording) -> list[str]:
    """Of streams that share no time with the longest."""
    names = [name for name in recording if len(recording[name])]
    if not names:
        return []
    longest = max(names, key=lambda name: np.ptp(recording[name].time))
    said = [no_shared_time(recording, name, longest) for name in names if name != longest]
    return [f"{item[0].upper()}{item[1:]}." for item in said if item]


def _of_other_width(recording: Recording, platform: Platform) -> list[str]:
    """Of streams with another number of columns than the machine has parts."""
    said: list[str] = []
    for name in (item for item in recording if item in STREAMS):
        try:
            check_columns(recording, platform, [name])
        except UsageError as problem:
            said.append(f"{str(problem)[0].upper()}{str(problem)[1:]}.")
    return said


def _known(name: str) -> bool:
    if name.startswith("estimate_"):  # an estimator states what it likes
        return True
    try:
        stream_named(name)
    except UnknownName:
        return False
    return True


def _unused(name: str) -> str:
    hint = UnknownName("stream", name, LOGGED).hint
    meant = f": {hint}" if hint.startswith("did you mean") else "."
    return f"Nothing uses {name}, a stream of a name that we do not know{meant}"


def _entry(recording: Recording, name: str) -> Mapping[str, Any]:
    """What the log states of a stream."""
    stated = cast(Mapping[str, Any], recording.provenance.get("streams") or {})
    return stated.get(name) or {}


def _stream(recording: Recording, name: str) -> StreamContents:
    series, entry = recording[name], _entry(recording, name)
    noise = replace(measure_noise(measurements(name, series)), clock=clock_of(series))
    intervals = np.diff(series.time)
    wide = np.flatnonzero(intervals > GAP * noise.clock.period)
    wide = wide[np.argsort(-intervals[wide], kind="stable")]
    gaps = tuple((float(series.time[i]), float(series.time[i + 1])) for i in wide)
    unscaled = recording.unit_of(name) if entry.get("fit_scale") else ""
    stream = StreamContents(name, series, noise, not name.startswith(DERIVED), gaps, unscaled)
    return stream if stream.clocked else replace(stream, gaps=())


def contents_words(contents: Contents) -> str:
    """The table that `twin show` prints."""
    recording, facts = contents.recording, contents.recording.provenance
    kind = "a measured log" if facts.get("kind") == "log" else "a recording"
    length = recording.stop - recording.start
    lines = [
        f"{contents.source}: {kind} on {facts.get('platform') or 'no platform'}, "
        f"{printed(length, 's')}, {len(recording)} stream{'s' if len(recording) > 1 else ''}"
    ]
    lines += [f"  {key}: {text}" for key, text in _stated(facts)]
    lines += [f"  repaired: {repair}" for repair in recording.repairs]
    if contents.conventions.sentences:
        lines += ["", contents.conventions.text]
    for stream in contents.streams:
        lines += ["", *_stream_lines(stream)]
    if contents.findings:
        lines += ["", *contents.findings]
    return "\n".join(lines)


def _stated(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """What the log itself says, short enough for a line each."""
    known = {key: facts.get(key) for key in ("started", "seed")}
    words = [str(word) for word in cast(list[object], facts.get("command") or [])]
    known["command"] = " ".join([*(Path(word).name for word in words[:1]), *words[1:]])
    known |= cast(Mapping[str, Any], facts.get("environment") or {})
    known |= cast(Mapping[str, Any], facts.get("notes") or {})
    return [(key, str(value)) for key, value in known.items() if value not in (None, "")]


def _stream_lines(stream: StreamContents) -> list[str]:
    series, clock = stream.series, stream.noise.clock
    if len(series) < 2:
        return [f"{stream.name}: {'1 row' if len(series) else 'no rows'}"]
    head = (
        f"{stream.name}: {len(series)} rows from {series.time[0]:.3f} to {series.time[-1]:.3f} s, "
    )
    if stream.clocked:
        head += f"{three_digits(series.rate)} Hz, {_jitter(clock.jitter)}, {_gaps(stream)}"
    else:
        head += "each holds until the next"
    columns, values, unit = stream.shown
    factor, name = fitting(float(np.abs(values).max()), unit)
    name = "" if name == "1" else f" {name}"
    low, high = values.min(axis=0) / factor + 0.0, values.max(axis=0) / factor + 0.0
    ranges = ", ".join(
        f"{column} {three_digits(a)}" + (f" to {three_digits(b)}" if a < b else "")
        for column, a, b in zip(columns, low, high, strict=True)
    )
    remark = " (stands still)" if stream.still else ""
    remark += " (its scale is to be fitted)" if stream.unscaled else ""
    lines = [head, f"    {ranges}{name}{remark}"]
    if stream.measured and not stream.still:
        lines.append(f"    noise {_noise(stream, unit)}")
        lines += _at_rest(stream, unit)
    return lines


def _jitter(jitter: float) -> str:
    """What is below a nanosecond is the rounding of the stamps."""
    return f"jitter {printed(jitter, 's')}" if jitter > 1e-9 else "no jitter"


def _gaps(stream: StreamContents) -> str:
    clock = stream.noise.clock
    if not stream.gaps:
        return "no gap"
    start, stop = stream.gaps[0]
    count = f"{clock.gaps} gap" if clock.gaps == 1 else f"{clock.gaps} gaps, the longest"
    return f"{count} of {printed(stop - start, 's')} at {start:.3f} s"


def _noise(stream: StreamContents, unit: str) -> str:
    noise = stream.noise
    factor, name = fitting(float(noise.white.max()), unit)
    text = ", ".join(three_digits(sigma / factor) for sigma in noise.white)
    text += "" if name == "1" else f" {name}"
    text += " about the body axes" if stream.series.columns == ("w", "x", "y", "z") else ""
    if noise.quantised.any():
        text += f", in steps of {printed(float(noise.resolution.max()), unit)}"
    flagged = int(np.count_nonzero(noise.outliers))
    return text + (f", {flagged} outlier{'s' if flagged > 1 else ''}" if flagged else "")


def _at_rest(stream: StreamContents, unit: str) -> list[str]:
    """What the longest stretch at rest tells of noise that is slower than a sample."""
    slow = stream.noise.slow
    if slow is None:
        return []
    parts = [
        f"{name} {_each(value, unit)}{per}"
        for name, value, per in (
            ("random walk", slow.random_walk, " sqrt(s)"),
            ("bias instability", slow.bias_instability, ""),
            ("rate random walk", slow.rate_random_walk, "/sqrt(s)"),
        )
        if np.isfinite(value).any()
    ]
    span = f"    at rest from {slow.start:.1f} to {slow.stop:.1f} s: "
    return [span + "; ".join(parts)] if parts else []


def _each(values: Array, unit: str) -> str:
    """`0.31, -, 0.28 deg/s`; a dash where nothing was seen."""
    factor, name = fitting(float(np.nanmax(values)), unit)
    texts = [three_digits(v / factor) if np.isfinite(v) else "-" for v in values.tolist()]
    return f"{', '.join(texts)} {name}"


def contents_document(contents: Contents) -> dict[str, Any]:
    """What `twin show --json` prints; SI throughout, null where nothing is known."""
    recording, facts = contents.recording, contents.recording.provenance
    return {
        "log": contents.source,
        "kind": facts.get("kind"),
        "platform": facts.get("platform"),
        "start": recording.start,
        "stop": recording.stop,
        "time_origin": facts.get("time_origin"),
        "environment": facts.get("environment"),
        "notes": facts.get("notes"),
        "repairs": recording.repairs,
        "conventions": [
            {
                "stream": finding.stream,
                "streams": [correction.stream for correction in finding.corrections],
                "kind": finding.kind,
                "sentence": finding.sentence,
                "alternatives": finding.alternatives,
                "evidence": finding.evidence,
            }
            for finding in contents.conventions.findings
        ],
        "log_toml": contents.conventions.log_toml or None,
        "findings": contents.findings,
        "streams": [
            _stream_document(stream, _entry(recording, stream.name)) for stream in contents.streams
        ],
    }


def _stream_document(stream: StreamContents, entry: Mapping[str, Any]) -> dict[str, Any]:
    series, noise = stream.series, stream.noise
    rows = len(series)
    known = stream.measured and not stream.still
    return {
        "name": stream.name,
        "unit": series.unit,
        "rows": rows,
        "start": series.time[0] if rows else None,
        "stop": series.time[-1] if rows else None,
        "rate": series.rate if stream.clocked else None,
        "jitter": noise.clock.jitter if stream.clocked else None,
        "gaps": _gaps_document(stream) if stream.clocked else None,
        "repeated": noise.clock.repeated,
        "columns": [
            {"name": name, "min": column.min(), "max": column.max()}
            for name, column in zip(series.columns, series.value.T, strict=True)
            if rows
        ],
        "noise": noise.white if known else None,
        "resolution": noise.resolution if known else None,
        "at_rest": _slow_document(stream) if known else None,
        "outliers": int(np.count_nonzero(noise.outliers)) if known else None,
        "stated": entry or None,
    }


def _slow_document(stream: StreamContents) -> dict[str, Any] | None:
    slow = stream.noise.slow
    if slow is None:
        return None
    return {
        "start": slow.start,
        "stop": slow.stop,
        "tau": slow.tau,
        "allan_deviation": slow.deviation,
        "random_walk": slow.random_walk,
        "bias_instability": slow.bias_instability,
        "rate_random_walk": slow.rate_random_walk,
    }


def _gaps_document(stream: StreamContents) -> dict[str, Any]:
    clock = stream.noise.clock
    return {
        "count": clock.gaps,
        "samples_lost": clock.lost,
        "longest": clock.longest_gap,
        "at": stream.gaps[:LISTED],
    }


def _impossible(recording: Recording, platform: Platform, *, read_rightly: bool) -> list[str]:
    """Why the log cannot be of that machine; how it leans says nothing where it is read wrongly."""
    try:
        check_possible(recording, platform)
        if read_rightly:
            motion = motion_of(recording, platform)
            check_within_stop(recording, platform, motion, "look at units, signs and axes")
    except ImpossibleLog as problem:
        return [f"{problem}."]
    except TwinError:  # without the streams that show a motion
        pass
    return []


def with_prediction(account: Account) -> Recording:
    """An account's first log plus `predicted_*` (a start fitted a stretch) and `residual_*`.

    The residual of an attitude is a rotation vector [rad] in body axes.
    """
    body = account.problem.bodies[0]
    streams = dict(body.recording.streams)
    for output, left in zip(body.outputs, account.left[0], strict=True):
        error = left * output.sigma
        series = body.recording[output.stream]
        if output.stream == "attitude":
            predicted = rotation.multiply(output.value, rotation.from_rotation_vector(-error))
        else:
            predicted = output.value - error
        unit = "rad" if output.stream == "attitude" else series.unit
        streams[f"{PREDICTED}{output.stream}"] = Series(
            output.time, predicted, series.columns, series.unit
        )
        streams[f"{RESIDUAL}{output.stream}"] = Series(output.time, error, output.columns, unit)
    return replace(body.recording, streams=streams)
