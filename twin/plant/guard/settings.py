"""What a laboratory allows its machine to do, beside what its parts can do."""

from dataclasses import dataclass, replace

import numpy as np

from twin.platform import Platform


@dataclass(frozen=True, kw_only=True)
class GuardSettings:
    """Numbers of the rules of `twin.plant.guard`; the parts' own limits are in the platform."""

    max_balance_step: float
    """Largest change of the gravity torque m g r by one move while floating [N m]."""
    tilt_cutout: float
    """Lean at which all stops [rad]; inf: the operator watches it."""
    height_margin: float = 0.0
    """So far below the CR the CM stays while floating, as the mass moment -m r z [kg m]."""
    stroke_margin: float = 0.0
    """Kept free at both ends of a stage's travel [m]."""
    horizon: float = 0.25
    """No move is longer than a stage's speed times this [s]: what a drive without a watchdog
    still does after its host has died."""
    momentum_share: float = 0.9
    """Of a wheel's momentum limit that may be used."""
    stale_cycles: int = 5
    """Control periods in a row without a fresh sample of a stream before all stops."""
    watchdog: float = np.inf
    """Longest time between two commands before all stops [s], by the wall's clock; inf where the
    plant's time is not the wall's, or to have none."""
    air_pressure: float = 0.0
    """The machine floats above this [Pa], where `air_pressure` is measured and `floating` not."""


WATCHDOG = 1.0
"""Longest silence of a loop on the wall's clock [s] unless stated: far more than a tick that is
late on a busy computer, far less than a lean takes to grow."""


def guard_settings(platform: Platform) -> GuardSettings:
    """What suits a machine of which nothing is stated.

    A balance step of a hundredth of what its masses can do from end to end, and a cut-out at eight
    tenths of the way to the stop.
    """
    reach = sum(stage.mass * (stage.travel[1] - stage.travel[0]) for stage in platform.stages)
    return GuardSettings(
        max_balance_step=0.01 * platform.gravity * reach if reach else np.inf,
        tilt_cutout=0.8 * platform.stop_angle,
    )


def bench_settings(platform: Platform) -> GuardSettings:
    """What suits it where its time is the wall's: a loop that hangs is noticed, too."""
    return replace(guard_settings(platform), watchdog=max(WATCHDOG, 3.0 * platform.tick))
