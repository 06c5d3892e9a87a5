"""What each run of a campaign is: its arm, the values of its factors, and what follows of them.

Run i flies combination i mod P of the P combinations of arms and grids, with sample i // P of the
distributions: the combinations meet the same machines, which makes their comparison a paired one.
All of it depends on the specification and the number of the run alone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.distribution import shares
from twin.campaigns.spec import Arm, Initial, Spec
from twin.effects import Effect
from twin.plant.initial import InitialState, check_within_stop, hanging
from twin.procedures.means import Reach
from twin.rotation import from_euler_zyx, multiply

Array = NDArray[np.float64]

SHY = np.radians(1.0)
"""How far before its stop a body starts that would hang beyond it [rad]."""


@dataclass(frozen=True)
class Drawn:
    """Some runs of a campaign."""

    runs: tuple[int, ...]
    arms: NDArray[np.intp]
    """(n,) number of the arm."""
    values: Mapping[str, Array]
    """(n,) of each factor that is not the same in all runs."""

    def at(self, rows: Sequence[int]) -> "Drawn":
        """Some of its rows."""
        index = np.array(rows, dtype=np.intp)
        values = {name: value[index] for name, value in self.values.items()}
        return Drawn(tuple(self.runs[row] for row in rows), self.arms[index], values)


def draw(spec: Spec, runs: Sequence[int]) -> Drawn:
    """The arms and values of some runs, ascending."""
    number = np.array(runs, dtype=np.int64)
    point, sample = number % spec.points, number // spec.points
    arms, point = point % len(spec.arms), point // len(spec.arms)
    values: dict[str, Array] = {}
    for factor, grid in spec.grids:
        values[factor.name] = np.array(grid)[point % len(grid)]
        point = point // len(grid)
    spread = spec.dispersed
    names = [factor.name for factor in spread]
    wanted = sorted(set(sample.tolist()))
    table = shares(spec.sampling, wanted, spec.samples, names, spec.seed)
    rows = np.searchsorted(wanted, sample)
    for column, factor in enumerate(spread):
        values[factor.name] = factor.distribution.at(table[rows, column])
    ordered = {factor.name: values[factor.name] for factor in spec.factors}
    return Drawn(tuple(runs), arms.astype(np.intp), ordered)


def effects_of_runs(arm: Arm, drawn: Drawn) -> list[tuple[Effect, ...]]:
    """The effects of each run; empty where all runs have those of the platform."""
    if not any(factor.name in drawn.values for e in arm.effects for factor in e.factors):
        return []
    return [
        tuple(
            effect.at({f.name: drawn.values[f.name][row] for f in effect.factors
                       if f.name in drawn.values})
            for effect in arm.effects
        )
        for row in range(len(drawn.runs))
    ]  # fmt: skip


def start_of_runs(initial: Initial, arm: Arm, drawn: Drawn) -> InitialState:
    """How the runs start, arrays (n, ...).

    Raises:
        UsageError: one of them would start beyond its tilt stop.
    """
    n, platform = len(drawn.runs), arm.platform
    given = {
        key: np.stack(
            [drawn.values.get(f.name, np.full(n, f.distribution.middle)) for f in factors], axis=1
        )
        for key, factors in initial.factors.items()
    }
    offset = given.get("center_of_mass_offset")
    if offset is not None and initial.within_reach:
        offset = Reach.of(platform).undone_by(offset)
    position = given.get("stage_position", np.zeros((n, len(platform.stages))))
    angles = given.get("attitude", np.zeros((n, 3)))
    attitude = from_euler_zyx(angles[:, 2], angles[:, 1], angles[:, 0])
    if initial.hangs:
        base = platform.center_of_mass_offset if offset is None else offset
        moment = np.broadcast_to(base, (n, 3)).copy()
        for stage, column in zip(platform.stages, position.T, strict=True):
            moment += stage.mass * column[:, None] * stage.axis
        attitude = multiply(hanging(moment, platform.stop_angle - SHY), attitude)
    check_within_stop(platform, attitude)
    return InitialState(
        attitude=attitude,
        rate_body=given.get("rate", np.zeros((n, 3))),
        velocity=given.get("velocity", np.zeros((n, 3))),
        joint_angle=given.get("joint_angle", 0.0),
        joint_rate=given.get("joint_rate", 0.0),
        wheel_speed=given.get("wheel_speed"),
        stage_position=position,
        gimbal_angle=given.get("gimbal_angle"),
        center_of_mass_offset=offset,
    )
