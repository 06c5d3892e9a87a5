"""Specification of a campaign: its runs, what differs between them, and their metrics."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from twin.campaigns.distribution import Distribution, Fixed, GridValues, Sampling, of_a_point
from twin.effects import Effect
from twin.platform import Platform

Procedure = Literal["run", "balance"]

SHARD = 256
"""Runs of a shard unless the specification says otherwise: enough that a law costs little beside
the physics, few enough that a shard is lost cheaply."""
PARTS = 8
SMALLEST_SHARD: dict[Procedure, int] = {"run": 32, "balance": 4}
"""Runs of a shard, at least: a campaign of fewer than `PARTS` usual shards is cut into `PARTS`. No
core waits for long, and a balancing, which fits each run for itself, loses little when it is cut
short. It must not depend on the machine, for shards are files."""


@dataclass(frozen=True)
class Factor:
    """One number that may differ from run to run."""

    name: str
    """`effects.gyro_bias.bias_x`, `gains.derivative`, `initial.roll`, ..."""
    unit: str
    """SI."""
    distribution: Distribution

    @property
    def dispersed(self) -> bool:
        """Whether it differs by a distribution, and not by a grid."""
        return not isinstance(self.distribution, Fixed | GridValues)


@dataclass(frozen=True)
class DispersedEffect:
    """An effect whose parameters are factors."""

    called: str
    """Name or file, as the specification has it."""
    kind: type[Effect]
    target: str
    settings: Mapping[str, Any]
    factors: tuple[Factor, ...]
    """One a component, in the order of the effect's values."""

    def at(self, values: Mapping[str, float]) -> Effect:
        """The effect of one run; factors without a value there are at their middle.

        Raises:
            EffectError: out of bounds.
        """
        numbers = [float(values.get(f.name, f.distribution.middle)) for f in self.factors]
        return self.kind(**self.kind.named(numbers), **self.settings, target=self.target)


@dataclass(frozen=True)
class Arm:
    """One of the ways that a campaign compares; a campaign without comparison has one."""

    name: str
    machine: str
    """Name or folder of the platform, as the specification has it."""
    platform: Platform
    """With the effects of all runs at their middle, and with those that it states itself."""
    known: Platform
    """What a procedure knows of it: as it is stated."""
    controller: str
    """Name or file of the law; of a balancing, the way."""
    target: float
    """Residual torque of a balancing [N m]; 0 for a run."""
    gains: Mapping[str, float]
    """Gains that differ from the law's defaults and are the same in all runs of the arm."""
    estimator: str
    reference: str
    """Empty: what the law is usually given."""
    effects: tuple[DispersedEffect, ...]
    """All effects of the platform, in its order."""


@dataclass(frozen=True)
class Initial:
    """How the runs start; factors by what they are of."""

    factors: Mapping[str, tuple[Factor, ...]] = field(default_factory=dict[str, tuple[Factor, ...]])
    """`attitude`, `rate`, `center_of_mass_offset`, ...: their components."""
    hangs: bool = False
    """Whether the attitude counts from where the body hangs, or stands before its stop."""
    within_reach: bool = False
    """Whether the CM is anywhere that the masses can undo; the factors are then where they would
    have to stand, as parts of their travel."""


@dataclass(frozen=True)
class Keep:
    """Which runs are recorded in full, after all have been flown."""

    runs: tuple[int, ...] = ()
    worst: int = 0
    by: str = ""
    """The metric that says which are the worst."""


@dataclass(frozen=True)
class Spec:
    """A campaign as its file says."""

    path: Path
    text: str
    arms: tuple[Arm, ...]
    procedure: Procedure
    runs: int
    duration: float
    """[s]."""
    steady: float
    """Of the end of a run that counts as steady [s]."""
    seed: int
    sampling: Sampling
    gains: tuple[Factor, ...]
    initial: Initial
    metrics: tuple[str, ...]
    keep: Keep
    shard: int
    """Runs of one."""

    @property
    def factors(self) -> tuple[Factor, ...]:
        """All that differ from run to run, in the order of the file."""
        result = [*self.gains]
        for effect in self.arms[0].effects:
            result += effect.factors
        for of in self.initial.factors.values():
            result += of
        return tuple(f for f in result if not isinstance(f.distribution, Fixed))

    @property
    def grids(self) -> tuple[tuple[Factor, tuple[float, ...]], ...]:
        """Factors on a grid, with their values."""
        return tuple(
            (f, f.distribution.values)
            for f in self.factors
            if isinstance(f.distribution, GridValues)
        )

    @property
    def dispersed(self) -> tuple[Factor, ...]:
        """Those that differ by a distribution."""
        return tuple(factor for factor in self.factors if factor.dispersed)

    @property
    def together(self) -> int:
        """Samples that belong together, being drawn of one point; 1 but for a Saltelli design."""
        return of_a_point(len(self.dispersed)) if self.sampling == "saltelli" else 1

    @property
    def points(self) -> int:
        """Combinations of arms and grids, of which every sample flies each."""
        count = len(self.arms)
        for _, values in self.grids:
            count *= len(values)
        return count

    @property
    def samples(self) -> int:
        """Draws from the distributions."""
        return self.runs // self.points

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.runs // self.shard)

    def runs_of(self, shard: int) -> range:
        """The runs of a shard."""
        return range(shard * self.shard, min((shard + 1) * self.shard, self.runs))
