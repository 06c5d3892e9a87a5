"""Trial flights of a control law that nobody has checked yet, over every kind of estimate."""

import copy
import dataclasses
import inspect
from pathlib import Path
from typing import Any, cast

import numpy as np

from twin.controller.controller import AnyController
from twin.controller.load import raised_at
from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import normalized
from twin.signals import Command, Estimate, Target

TICKS = 5
"""Of a trial flight."""


class Broken(Exception):
    """So wrong that further trials would only repeat it."""


def fly(law: AnyController, platform: Platform, estimates: list[Estimate]) -> list[Command]:
    """Commands tick by tick, on what the law is told and not on what it does."""
    state = start(law, platform, len(estimates[0].valid))
    commands: list[Command] = []
    for estimate, target in zip(estimates, targets(), strict=True):
        # Copies, so that a law that changes its arguments does not change the trial.
        command, state = update(law, state, copy.deepcopy(estimate), copy.deepcopy(target))
        commands.append(command)
    return commands


def start(law: AnyController, platform: Platform, n: int) -> Any:
    """The law's first state."""
    try:
        return law.init(platform, n)
    except ControllerError as problem:
        raise Broken(
            f"it refuses {platform.name} ({problem}): check it on another (--platform)"
        ) from None
    except Exception as problem:
        raise Broken(f"init fails with n = {n}: {_raised(law, problem)}") from problem


def update(
    law: AnyController, state: Any, estimate: Estimate, target: Target
) -> tuple[Command, Any]:
    """One tick; its answer has the right form, if not the right content."""
    try:
        with np.errstate(all="ignore"):
            answer = cast(object, law.update(state, estimate, target, estimate.time))
    except Exception as problem:
        n = len(estimate.valid)
        raise Broken(f"update fails with n = {n}: {_raised(law, problem)}") from problem
    if not isinstance(answer, tuple) or len(cast(tuple[Any, ...], answer)) != 2:
        kind = type(cast(object, answer)).__name__
        raise Broken(f"update returns a {kind}, not (command, state): `return command, state`")
    command, after = cast(tuple[Any, Any], answer)
    if not isinstance(command, dict):
        raise Broken(
            f"the command is a {type(command).__name__}, not a dict of streams: "
            '`return {"command_wheel_torque": torque}, state`'
        )
    return cast(Command, command), after


def estimates(platform: Platform, n: int) -> list[Estimate]:
    """At random; the first run on its target, the last upside down once, at first all unseen."""
    draw = np.random.default_rng(seed=20)
    hinges = int(platform.base.kind == "hinge")
    flight: list[Estimate] = []
    for tick, target in enumerate(targets()):
        attitude, rate = normalized(draw.normal(size=(n, 4))), 0.1 * draw.normal(size=(n, 3))
        if tick == 1:
            attitude[-1] = (0.0, 1.0, 0.0, 0.0)
        attitude[0], rate[0] = target.attitude, target.rate_body
        flight.append(
            Estimate(
                time=tick * platform.tick,
                attitude=attitude,
                rate_body=rate,
                wheel_speed=100.0 * draw.normal(size=(n, len(platform.wheels))),
                stage_position=0.01 * draw.normal(size=(n, len(platform.stages))),
                gimbal_angle=0.3 * draw.normal(size=(n, len(platform.gimbals))),
                joint_angle=draw.normal(size=(n, hinges)),
                joint_rate=draw.normal(size=(n, hinges)),
                gyro_bias=1e-3 * draw.normal(size=(n, 3)),
                valid=np.full(n, tick > 0),
                oriented=np.full(n, tick > 0),
            )
        )
    return flight


def targets() -> list[Target]:
    """Level and at rest, then moving; one a tick."""
    draw = np.random.default_rng(seed=21)
    level = Target(np.array([1.0, 0.0, 0.0, 0.0]))
    moving = Target(
        normalized(draw.normal(size=4)), 0.1 * draw.normal(size=3), 0.01 * draw.normal(size=3)
    )
    return [level, level, *[moving] * (TICKS - 2)]


def rows_of(estimate: Estimate, rows: list[int]) -> Estimate:
    """The estimate of those runs."""
    arrays = {
        field.name: getattr(estimate, field.name)[rows]
        for field in dataclasses.fields(estimate)
        if isinstance(getattr(estimate, field.name), np.ndarray)
    }
    return dataclasses.replace(estimate, **arrays)


def _raised(law: AnyController, problem: Exception) -> str:
    return raised_at(Path(inspect.getfile(type(law))), problem)
