"""How a run went, in lines for a terminal."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from twin.loop import Outcome
from twin.platform import Platform


def flown(platform: Platform, outcome: Outcome, row: Mapping[str, Any], settle: float) -> list[str]:
    """What happened, in words a lab uses: degrees and newton metre seconds.

    Args:
        platform: the machine.
        outcome: how the loop ended.
        row: its metrics, by name.
        settle: from which on tracking counts [s].
    """
    end = f"{outcome.ended.value} after {outcome.duration:g} s"
    lines = [f"{end}: {outcome.reason}" if outcome.reason else end]
    if "tracking_error_rms_rad" in row:
        rms, worst = np.degrees([row["tracking_error_rms_rad"], row["tracking_error_max_rad"]])
        lines.append(
            f"tracking error {rms:.3g} deg rms, {worst:.3g} deg at worst, from {settle:g} s on"
        )
    if "tilt_max_rad" in row:
        most = row["tilt_max_rad"]
        touched = platform.pitch_stop is None and most >= platform.tilt_limit
        stop = ", where it touched its stop" if touched else ""
        lines.append(f"largest tilt {np.degrees(most):.3g} deg{stop}")
    peaks = row.get("wheel_momentum_max_N_m_s", ())
    if "wheel_speed" not in platform.sensors:
        # nobody has seen them
        peaks = ()
    for wheel, peak in zip(platform.wheels, peaks, strict=bool(len(peaks))):
        lines.append(f"{wheel.name} held up to {peak:.3g} of {wheel.momentum_limit:g} N m s")
    if np.isfinite(row.get("wheel_saturated_at_s", np.nan)):
        lines.append(f"a wheel was saturated from {row['wheel_saturated_at_s']:.1f} s on")
    timing = outcome.timing
    if timing.lateness:
        p50, p99, most = (timing.lateness_at(p) * 1e3 for p in (50.0, 99.0, 100.0))
        own50, own99, longest = (timing.own_at(p) * 1e3 for p in (50.0, 99.0, 100.0))
        lines.append(
            f"ticks came {p50:.2f} ms late (median), {p99:.2f} ms (99 %), {most:.2f} ms at most; "
            f"{timing.overruns} overruns in {timing.ticks} ticks"
        )
        lines.append(
            f"each took {own50:.2f} ms (median), {own99:.2f} ms (99 %), {longest:.2f} ms at most, "
            f"of {platform.tick * 1e3:g} ms"
        )
    return lines
