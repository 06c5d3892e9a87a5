"""A check that any author can run on a control law: does it keep the contract of `Controller`?

Every complaint says what is most likely wrong. A law that passes may still control badly: the
check knows nothing about the machine beyond the commands it takes.
"""

import copy
import dataclasses
import inspect
import pickle
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any, cast

import numpy as np

from twin.controller.controller import AnyController
from twin.controller.load import called, load_controller, raised_at
from twin.errors import ControllerError, UnknownName
from twin.library import model_names
from twin.platform import Platform, load_platform
from twin.rotation import normalized
from twin.signals import Command, Estimate, Target

TICKS = 5
"""Of a trial flight."""


class Broken(Exception):
    """So wrong that further trials would only repeat it."""


def fly_rows(law: AnyController, platform: Platform, estimates: list[Estimate]) -> list[Command]:
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


_PARTS = {
    "command_wheel_torque": "wheels",
    "command_stage_position": "stages",
    "command_gimbal_rate": "gimbals",
    "command_thruster": "thrusters",
}
"""Whose columns a command has."""


def check_controller(
    controller: AnyController | str | Path, platform: Platform | None = None
) -> list[str]:
    """Check a law, or the law of that name or file, on a platform.

    Unless one is given, it is its `usual_machine`.

    Returns:
        One sentence for each promise that the law breaks; empty when it keeps them all.

    Raises:
        UnknownName: no such law.
        UsageError: no such file.
        ControllerError: the file holds no law that can be loaded.
    """
    law = load_controller(str(controller)) if isinstance(controller, str | Path) else controller
    platform = platform or usual_machine(law)
    findings = list(_declared(law))
    try:
        for promise in (_answers, _repeatable, _independent_rows, _vectorised):
            broken = list(promise(law, platform))
            if broken:  # those after it take it for granted
                return findings + broken
    except Broken as problem:
        findings.append(str(problem))
    return findings


def usual_machine(law: AnyController) -> Platform:
    """What a law is judged on where nobody names another: the first shipped platform that it does
    not refuse, `sads` before the others, and `sads` if it refuses all."""
    usual = load_platform("sads")
    for name in ("sads", *model_names()):
        platform = load_platform(name)
        try:
            law.init(platform, 1)
        except ControllerError:
            continue
        except Exception:  # the check itself tells
            return platform
        return platform
    return usual


def _declared(law: AnyController) -> Iterator[str]:
    """A frozen dataclass, each gain with its unit."""
    name = type(law).__name__
    if not dataclasses.is_dataclass(law):
        yield f"{name} is no dataclass: put @dataclass(frozen=True) above it"
        return
    if not cast(Any, law).__dataclass_params__.frozen:
        yield f"{name} can change while it flies: make it @dataclass(frozen=True)"
    for field in dataclasses.fields(law):
        if isinstance(getattr(law, field.name), float) and "unit" not in field.metadata:
            yield (
                f"{called(field.name)} has no unit: declare it as "
                'field(default=..., metadata={"unit": "N m"}), "1" if it has none'
            )


def _answers(law: AnyController, platform: Platform) -> Iterator[str]:
    """It starts, and answers with commands that the machine takes, for one run and for many."""
    for n in (1, 256):
        for command in fly_rows(law, platform, estimates(platform, n)):
            wrong = [f"{problem} (n = {n})" for problem in _refused(platform, command, n)]
            if wrong:
                yield from wrong
                return


def _refused(platform: Platform, command: Command, n: int) -> Iterator[str]:
    for name, value in command.items():
        if name not in platform.commands:
            yield str(UnknownName(f"command of {platform.name}", name, platform.commands))
            continue
        shape, wanted = np.shape(value), (n, platform.commands[name])
        kind = str(getattr(value, "dtype", type(value).__name__))
        if kind != "float64":
            yield f"{name} is of type {kind}, not a float64 array: start from np.zeros or np.array"
        elif len(shape) == 2 and shape[0] == n and shape != wanted:
            yield _other_columns(platform, name, shape[1])
        elif shape != wanted:
            yield (
                f"{name} has shape {shape}, not {wanted}: the batch axis comes first, one row a "
                "run, also when there is only one"
            )
        elif not np.isfinite(value).all():
            yield (
                f"{name} holds {value[~np.isfinite(value)][0]} though all it was given is finite: "
                "look for a division by zero or a root below zero, at rest on target or upside down"
            )


def _other_columns(platform: Platform, command: str, result: int) -> str:
    parts = platform.columns(command)
    kind = _PARTS.get(command, "columns")
    return (
        f"{command} has {result} column{'s' * (result != 1)}, and {platform.name} has "
        f"{len(parts)} {kind if len(parts) > 1 else kind[:-1]} ({', '.join(parts)}): give each its "
        "column, in this order, or check the law on the machine that it is for (--platform)"
    )


def _repeatable(law: AnyController, platform: Platform) -> Iterator[str]:
    """The answer depends on the arguments alone, and they are left as they were."""
    state, estimate, target = start(law, platform, 3), estimates(platform, 3)[1], targets()[1]
    try:
        saved = pickle.dumps(state)
    except Exception as problem:
        yield (
            f"its state cannot be saved ({problem}): a run could not be replayed; keep numbers, "
            "arrays and dataclasses of them"
        )
        return
    before = copy.deepcopy((estimate, target))
    first, first_after = update(law, pickle.loads(saved), *copy.deepcopy(before))
    # Other answers between, so that a law that remembers in itself gives itself away.
    fly_rows(law, platform, estimates(platform, 3)[1:] + estimates(platform, 3)[:1])
    time.sleep(0.002)
    state = pickle.loads(saved)
    second, second_after = update(law, state, estimate, target)
    if not _equal([first], [second]) or pickle.dumps(first_after) != pickle.dumps(second_after):
        yield (
            "the same call twice gives two answers: it uses the clock (take `time`), random "
            "numbers, or remembers outside its state (on self, or in a global)"
        )
    if pickle.dumps(state) != pickle.dumps(pickle.loads(saved)):
        yield "it changes the state it is given: return a new one (dataclasses.replace, a + b)"
    changed = [
        f"{type(old).__name__.lower()}.{field.name}"
        for old, new in zip(before, (estimate, target), strict=True)
        for field in dataclasses.fields(old)
        if not np.array_equal(getattr(old, field.name), getattr(new, field.name))
    ]
    if changed:
        yield (
            f"it changes {', '.join(changed)} in place, which the recorder still needs: "
            "write x = x + y, not x += y, or copy first"
        )


def _independent_rows(law: AnyController, platform: Platform) -> Iterator[str]:
    """A run's command depends on that run alone."""
    three = estimates(platform, 3)
    together = fly_rows(law, platform, three)
    tumbling = [rows_of(estimate, [1, 1, 2]) for estimate in three]
    for estimate in tumbling:
        estimate.rate_body[0] = 10.0
    if not _equal(_rows(together, [1, 2]), _rows(fly_rows(law, platform, tumbling), [1, 2])):
        yield (
            "the command of a run changes with what happens to another run: some sum, mean, norm "
            "or `if` goes over the whole batch; give it axis=-1, or use np.where row by row"
        )
        return
    for row in range(3):
        alone = fly_rows(law, platform, [rows_of(estimate, [row]) for estimate in three])
        if not _equal(_rows(together, [row]), alone, tolerance=1e-9):
            yield (
                "a run alone gets another command than as one row of three: look for squeeze, "
                "for [0] where [:, 0] is meant, and for shapes that broadcast by accident"
            )
            return


def _vectorised(law: AnyController, platform: Platform) -> Iterator[str]:
    """Its Python work does not grow with the number of runs."""
    few, many = (_instructions(law, platform, n) for n in (8, 64))
    if many > 1.2 * few:
        yield (
            f"it executes {many} Python instructions for 64 runs and {few} for 8: it loops over "
            "the runs; let NumPy work on whole columns"
        )


def _instructions(law: AnyController, platform: Platform, n: int) -> int:
    """Python instructions of one tick: counted, because a time would depend on the machine."""
    state, estimate, target = start(law, platform, n), estimates(platform, n)[1], targets()[1]
    count = 0

    def trace(frame: FrameType, event: str, argument: object) -> Callable[..., Any]:
        nonlocal count
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        count += event == "opcode"
        return trace

    previous = sys.gettrace()
    sys.settrace(trace)
    try:
        law.update(state, estimate, target, estimate.time)
    finally:
        sys.settrace(previous)
    return count


def _rows(commands: list[Command], rows: list[int]) -> list[Command]:
    return [{name: value[rows] for name, value in command.items()} for command in commands]


def _equal(first: list[Command], second: list[Command], tolerance: float = 0.0) -> bool:
    return all(
        a.keys() == b.keys()
        and all(np.allclose(a[name], b[name], rtol=tolerance, atol=tolerance) for name in a)
        for a, b in zip(first, second, strict=True)
    )
