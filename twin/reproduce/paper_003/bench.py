"""The paper's tests: two laws from the same start, four times each, and its indexes of them.

The law is fed with what the IMU gives, as in the paper: no filter of ours stands between. The paper
stops after 300 s and calls its last values steady. With K_I = 2e-5 N m/s the masses settle at the
slow root K_I / (K_p + k), 1 / 139 s as the machine is shipped, so ours fly for LENGTH.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from twin.controller import AnyController, load_controller
from twin.effects import Effect, with_effects
from twin.plant.initial import InitialState, hanging
from twin.platform import Platform, load_platform
from twin.reproduce.flown import Flown, flown
from twin.rotation import cross, vertical_body

Array = NDArray[np.float64]

LENGTH, STEADY = 1200.0, 100.0
"""Of a run, and of its end that counts as steady [s]."""
PAPER_LENGTH = 300.0
"""Of a run of the paper [s]."""
FLOAT = 120.0
"""Of the free float after it [s]."""
RUNS = range(4)
"""As many tests as in the paper."""
SEED = 3
ONE_MOTOR, ALL_MOTORS = 0.041, 0.123
"""m_b [kg], by section 2 and by section 3 of the paper."""
OFFSET = 0.5e-3
"""[m], of every mass at the start; Table 1 has it negative."""
CUTOFF = 1.0
"""Of the low-pass filter before the residual torque is read [Hz]."""
SHY = np.radians(1.0)
"""How far from its stop a table that would hang beyond it starts [rad]."""


def mechanical() -> AnyController:
    """The law of eq. 8: all three terms by masses. Of a small tilt the error quaternion of
    `mass_pid` is half, hence twice the gains."""
    gains = {"proportional": 2e-3, "integral": 4e-5, "derivative": 1.8e-3}
    return load_controller("mass_pid", gains)


def mixed() -> AnyController:
    """The law of eq. 5 and 7, with the gains of the tables."""
    return load_controller("mass_magnetic_pid")


def table(side: float, mass: float = ALL_MOTORS, effects: Sequence[Effect] = ()) -> Platform:
    """The shipped table, balanced in the plane, its masses `side` x 0.5 mm off.

    Args:
        side: -1 for Table 1, 1 for Table 2.
        mass: of a sliding mass [kg].
        effects: beyond those that platform.toml states.
    """
    plain = load_platform("cubesat")
    stages = tuple(replace(stage, mass=mass) for stage in plain.stages)
    height = np.array([0.0, 0.0, plain.center_of_mass_offset[2]])
    offset = height + side * OFFSET * mass * np.sum([stage.axis for stage in stages], axis=0)
    return with_effects(replace(plain, stages=stages, center_of_mass_offset=offset), effects)


@dataclass(frozen=True)
class Tests:
    """One law on one table, and the free float after it."""

    run: Flown

    @cached_property
    def after(self) -> Flown:
        """Afloat with the masses as they stand."""
        return afloat(self.run)

    @cached_property
    def steady(self) -> Flown:
        """The end of it."""
        return self.run.between(self.run.time[-1] - STEADY, np.inf)

    @property
    def in_plane(self) -> Array:
        """Rms of gravity's part in the plane as the IMU shows it, (n,)."""
        return in_plane(self.steady)

    @property
    def in_plane_as_in_paper(self) -> Array:
        """The same, but of the last third of the paper's 300 s."""
        return in_plane(self.run.between(PAPER_LENGTH - STEADY, PAPER_LENGTH))

    @property
    def mass_x(self) -> Array:
        """Steady position of the mass along x, from where it stood first, (m, n) [m]."""
        position = self.steady.true["stage_position"][..., 0]
        return position - position[0]

    @property
    def path(self) -> Array:
        """What both masses in the plane travel in the paper's 300 s, (n,) [m]."""
        position = self.run.between(0.0, PAPER_LENGTH).true["stage_position"]
        return np.abs(np.diff(position[..., :2], axis=0)).sum(axis=(0, 2))

    @property
    def torque(self) -> Array:
        """Residual torque of the free float, (n,) [N m]."""
        size = np.linalg.norm(momentum_change(self.after), axis=2)
        return np.percentile(size, 95.0, axis=0)


def in_plane(run: Flown) -> Array:
    """Rms of gravity's direction in the body's horizontal plane, as the law sees it, (n,)."""
    up = vertical_body(run.seen["attitude"])
    return np.sqrt(np.mean(np.sum(np.square(up[..., :2]), axis=2), axis=0))


def fly_tests(platform: Platform, law: AnyController, length: float = LENGTH) -> Tests:
    """Four runs from where the table rests, or from before its stop where it would lie on it."""
    rest = hanging(platform.center_of_mass_offset, platform.stop_angle - SHY)
    start = InitialState(attitude=rest)
    kind = "passthrough"
    return Tests(flown(platform, law, length, start=start, estimator=kind, runs=RUNS, seed=SEED))


def afloat(run: Flown) -> Flown:
    """What comes after a run without any command."""
    law = load_controller("free_float")
    numbers = range(len(RUNS), len(RUNS) + run.true["rate"].shape[1])
    return flown(
        run.platform,
        law,
        FLOAT,
        start=run.end(),
        estimator="passthrough",
        runs=numbers,
        seed=SEED,
    )


def momentum_change(run: Flown) -> Array:
    """J dw/dt + w x J w of the gyro below `CUTOFF`, without its mean, (m, n, 3) [N m].

    The ends, where filter and derivative lack a side, are left out.
    """
    tick = run.platform.tick
    measured = run.seen["rate"] - run.seen["rate"].mean(axis=0)
    filtered = butter(2, CUTOFF, fs=1.0 / tick, output="sos")
    rate = np.asarray(sosfiltfilt(filtered, measured[1:], axis=0))
    momentum = rate @ run.platform.inertia
    change = np.asarray(np.gradient(momentum, tick, axis=0)) + cross(rate, momentum)
    edge = round(1.0 / (CUTOFF * tick))
    return change[edge:-edge]


def ratio(above: Array, below: Array) -> tuple[float, float, float]:
    """Of two means over the tests, with the 95 % interval of their scatter."""
    value = float(np.mean(above) / np.mean(below))
    shares = [np.var(x, ddof=1) / len(x) / np.mean(x) ** 2 for x in (above, below)]
    half = 2.45 * float(np.sqrt(np.sum(shares)))  # Student's t of 2 x 3 degrees of freedom
    return value, value * max(1.0 - half, 0.0), value * (1.0 + half)
