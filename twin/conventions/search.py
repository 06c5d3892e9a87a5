"""Is a log read rightly? Units first, then axes, order, direction and clock in one search."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from twin.conventions.body import BodyStreams
from twin.conventions.correction import (
    CLOSE,
    Correction,
    apply_all,
    stated,
    unit_change,
    unit_changes,
)
from twin.conventions.evidence import CERTAIN, ConventionFinding, choose, findings_of, words_of
from twin.conventions.gravity import gravity_as_rate, median_length
from twin.conventions.hypothesis import Hypothesis
from twin.conventions.joint import joint_findings
from twin.conventions.room_vectors import field_findings, gyro_findings
from twin.conventions.time_base import time_unit_changes
from twin.conventions.turning import (
    NEAR,
    far_lags,
    needs_a_bias,
    no_common_motion,
    turning_of,
)
from twin.conventions.vertical import vertical_findings, vertical_of
from twin.noise.cleaning import without_steps
from twin.platform import Platform, field_world
from twin.recording import Recording
from twin.recording.pauses import longest_of
from twin.signals import OF_MOTION
from twin.units import STANDARD_GRAVITY

SIGNIFICANT = 8.0
"""Sigmas of correlation without which a gyro's unit is not spoken of."""
SAME = 0.8
"""Correlation beneath the noise below which two motions are not one in two units."""
WORSE = 1.1
"""By which ratio two streams may be further apart: their grid shifts with their clocks."""
ALIKE = np.radians(1.0)
"""Angles off upright that differ by less are alike [rad]."""


def check_conventions(
    recording: Recording, platform: Platform | None = None
) -> list[ConventionFinding]:
    """Look for streams that were read in a wrong convention.

    Nothing but physics that needs no parameters, or rough ones: a rate is the derivative of an
    angle; an accelerometer at rest shows g, upwards; a wheel gives what the body takes. Noise,
    latencies up to 0.1 s, biases and an inertia off by a few tenths are no findings.

    Args:
        recording: what was read; a simulation's true states are not looked at.
        platform: its wheels and inertia; without one, the wheels are not checked.

    Returns:
        A finding for each wrong stream, none for a right log. Findings with `alternatives` belong
        to a log whose motion is too poor to choose among several readings.
    """
    recording = _scaled(recording.without_truth())
    plain = time_unit_changes(recording, platform)
    recording = longest_of(apply_all(recording, plain))
    gravity = platform.gravity if platform else STANDARD_GRAVITY
    field = float(np.linalg.norm(field_world(recording, platform)))
    for unit in (
        _unit_by_length(recording, "accelerometer", gravity),
        _unit_by_length(recording, "magnetometer", field),
        _inclinometer_unit(recording),
    ):
        plain += unit
        recording = apply_all(recording, unit)
    gravity_shown = gravity_as_rate(recording)
    if gravity_shown is not None:
        kept = {name: series for name, series in recording.items() if name != "gyro"}
        recording = replace(recording, streams=kept)
    unit = _gyro_unit(recording)
    # a clock that steps and a heading that is reset are undone before a fit, and no conventions
    scaled, _ = without_steps(apply_all(recording, unit))
    turning = turning_of(scaled)
    strange = no_common_motion(scaled, turning) if turning is not None else None
    if strange is None:  # a unit is a ratio of two motions, and means nothing where they differ
        plain += unit
        recording = scaled
    if turning is None or strange is not None:
        result = [ConventionFinding(c, CERTAIN) for c in plain] + joint_findings(
            recording, platform
        )
        result += [item for item in (gravity_shown, strange) if item is not None]
        if "attitude" in recording:
            beside = vertical_findings(recording, gravity)
        else:
            beside = gyro_findings(recording)
        return result + _sound(recording, beside, gravity)
    body = BodyStreams(recording, platform, turning)
    wheels = _wheel_unit(body, recording) if "wheel_speed" in recording else None
    if wheels is not None:
        plain.append(wheels)
        body = body.with_wheels_in(wheels)
    result = [ConventionFinding(c, CERTAIN) for c in plain] + joint_findings(recording, platform)
    return result + _with_field(recording, _choose(body, body.with_wheels()), gravity)


def _with_field(
    recording: Recording, findings: list[ConventionFinding], gravity: float
) -> list[ConventionFinding]:
    """The sound ones of these findings, and the magnetometer beside the attitude put right."""
    sound = _sound(recording, findings, gravity)
    if sound != findings or any(finding.ambiguous for finding in findings):
        return sound
    mended = corrected(recording, findings)
    turning = turning_of(mended)
    if turning is not None and turning.agrees:
        return sound + field_findings(mended)
    # noise hides which gyro the attitude has, and any of the others may be wrong
    beside = [] if findings else vertical_findings(recording, gravity)
    return sound + _sound(recording, beside, gravity)


def _scaled(recording: Recording) -> Recording:
    """Without what fits nothing as it is: streams whose scale is yet to be fitted, or that stand
    still."""
    kept = {
        name: series
        for name, series in recording.items()
        if not stated(recording, name).get("fit_scale")
        and not (name in OF_MOTION and series.stands_still)
    }
    return replace(recording, streams=kept)


def _choose(body: BodyStreams, ranked: list[Hypothesis]) -> list[ConventionFinding]:
    """What the best hypothesis says, if it clearly beats the log as read; with its equals."""
    chosen, certainty = choose(ranked, body.weigh)
    if not chosen:
        return []
    best, *rivals = (body.dated(h) for h in chosen)
    others = dict.fromkeys(words_of(h) for h in rivals if words_of(h) != words_of(best))
    return list(findings_of(best.corrections, certainty, tuple(others)))


def _sound(
    recording: Recording, findings: list[ConventionFinding], gravity: float
) -> list[ConventionFinding]:
    """The findings, or none where they would part the streams further."""
    corrections = [c for finding in findings for c in finding.corrections]
    return findings if brings_together(recording, corrections, gravity) else []


def brings_together(
    recording: Recording, corrections: Sequence[Correction], gravity: float
) -> bool:
    """Whether no two streams are further apart with the corrections than without.

    Looked at on the corrected streams themselves: the gyro against the rate of the attitude, the
    accelerometer against upright. Wheels have no part in it.

    Args:
        recording: as read, in the right units.
        corrections: of a reading that is to be advised.
        gravity: [m/s^2].
    """
    mended = apply_all(recording, corrections)
    before, after = turning_of(recording), turning_of(mended)
    if before is not None and after is not None and after.strain > WORSE * before.strain:
        return False
    as_read, right = (vertical_of(log, gravity) for log in (recording, mended))
    if as_read is None or right is None:
        return True
    same = np.eye(4), np.eye(3)
    allowed = ALIKE + right.shaken_aside
    return right.angle(*same) <= max(WORSE * as_read.angle(*same), as_read.angle(*same) + allowed)


def corrected(recording: Recording, findings: list[ConventionFinding]) -> Recording:
    """The recording as it should have been read, by the findings that name one reading only."""
    sure = [finding for finding in findings if not finding.ambiguous]
    return apply_all(recording, (c for finding in sure for c in finding.corrections))


def _unit_by_length(recording: Recording, stream: str, length: float) -> list[Correction]:
    """The unit in which a vector is as long as it must be [SI]; none where that is unknown (0)."""
    shown = median_length(recording, stream)
    change = unit_change(recording, stream, length / shown) if shown and length else None
    return [] if change is None else [change]


def _inclinometer_unit(recording: Recording) -> list[Correction]:
    """Degrees, where nothing stands so steeply in what was read."""
    if "inclinometer" not in recording or not len(recording["inclinometer"]):
        return []
    if float(np.abs(recording["inclinometer"].value).max()) <= 0.5 * np.pi:
        return []
    changes = unit_changes(recording, "inclinometer")
    return [change for change in changes if ("unit", "deg") in change.keys]


def _wheel_unit(body: BodyStreams, recording: Recording) -> Correction | None:
    """The unit in which the wheels answer the body; None for the one they were read in.

    In too large numbers their noise hides that they answer it: then each unit is tried with its
    own noise, and must ask for no other.
    """
    factor = body.wheel_factor()
    if factor is not None:
        return unit_change(recording, "wheel_speed", factor)
    for change in unit_changes(recording, "wheel_speed"):
        factor = body.with_wheels_in(change).wheel_factor()
        if factor is not None and abs(np.log(factor)) < CLOSE:
            return change
    return None


def _gyro_unit(recording: Recording) -> list[Correction]:
    """The unit in which the gyro follows the attitude; none for the one it was read in.

    The noise goes with the unit, and with it how much of the motion is seen: each unit is tried
    with its own, and must then ask for no other.
    """
    if turning_of(recording) is None:
        return []
    best, sigmas = list[Correction](), SIGNIFICANT
    for option in ([], *([change] for change in unit_changes(recording, "gyro"))):
        turning = turning_of(apply_all(recording, option))
        if turning is None:
            continue
        factor, seen, alike = turning.factor(
            np.concatenate([NEAR[::5], far_lags(turning.grid.longest_lag, 0.25)])
        )
        if abs(np.log(factor)) < CLOSE and seen > sigmas:
            if not option:
                return []
            if alike > SAME and not needs_a_bias(apply_all(recording, option), turning):
                best, sigmas = option, seen
    return best
