"""A specification from its TOML file: every mistake is a sentence before any run starts."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import cast

from twin.campaigns.merit import METRICS, metric_names
from twin.campaigns.read_arms import gain_fields, read_arms
from twin.campaigns.read_initial import read_initial
from twin.campaigns.read_values import read_values
from twin.campaigns.sampling import SAMPLINGS, Sampling
from twin.campaigns.spec import LEAST, PARTS, SHARD, Arm, Factor, Keep, Procedure, Spec
from twin.clock import LONGEST
from twin.config import Table, read_toml
from twin.controller import load_controller
from twin.errors import CampaignError, UnknownName

MOST = 10**9
"""Runs of a campaign; a Sobol sequence ends at 2^30 samples."""

MOST_SEED = 2**53
"""Above this a number of TOML is no longer the one that was written."""

KEYS = ("platform", "controller", "estimator", "procedure", "reference", "target", "runs",
        "duration", "steady", "seed", "sampling", "metrics", "shard", "gains", "effects",
        "initial", "arms", "keep")  # fmt: skip


def read_spec(path: Path) -> Spec:
    """The campaign of a file.

    Raises:
        CampaignError: it cannot be flown as it stands; names file, line, key and remedy.
    """
    table = read_toml(path, CampaignError)
    _refuse_unknown(table)
    procedure = cast(Procedure, table.text("procedure", "run", among=("run", "balance")))
    if procedure == "balance":
        for key in ("reference", "steady"):
            if key in table:
                raise table.fail(key, "is of a run", "a balancing has none: leave it out")
    duration = table.number("duration", low=0.0, high=LONGEST, unit="s")
    if duration == 0.0:
        raise table.fail("duration", "is 0 s", "give a time above zero")
    steady = table.number("steady", 0.5 * duration, low=0.0, high=duration, unit="s")
    seed = table.whole("seed", low=0)
    if seed > MOST_SEED:
        raise table.fail("seed", f"is {seed}", f"give {MOST_SEED} at most")
    sampling = cast(Sampling, table.text("sampling", "random", among=SAMPLINGS))
    runs = table.whole("runs", low=1, high=MOST)
    usual = min(SHARD, max(LEAST[procedure], -(-runs // PARTS)))
    shard = table.whole("shard", usual, low=2, high=1 << 16)
    target = _target(table, procedure)
    arms = read_arms(table, procedure, target)
    tick = max(arm.platform.tick for arm in arms)
    if duration < tick:
        raise table.fail("duration", f"is {duration:g} s", f"give a tick of {tick:g} s at least")
    gains = _gains(table, arms, procedure)
    initial = read_initial(table, arms)
    names = metric_names(arms[0].platform, procedure)
    metrics = _metrics(table, "metrics", names)
    spec = Spec(
        path=path,
        text=path.read_text(encoding="utf-8-sig"),
        arms=arms,
        procedure=procedure,
        runs=runs,
        duration=duration,
        steady=steady,
        seed=seed,
        sampling=sampling,
        gains=gains,
        initial=initial,
        metrics=metrics,
        keep=_keep(table, runs, metrics),
        shard=shard,
    )
    table.close()
    _refuse_odd(table, spec)
    return spec


def _refuse_unknown(table: Table) -> None:
    """All keys that nobody knows, before one of them seems to be missing."""
    unknown = [key for key in table.keys if key not in KEYS]
    if unknown:
        first, *others = unknown
        hint = UnknownName("key", first, KEYS).hint
        rest = ", ".join(f"{key} (line {table.line(key)})" for key in others)
        raise table.fail(first, "is no key we know", hint + (f" Nor is {rest}" if rest else ""))


def _target(table: Table, procedure: Procedure) -> float | None:
    if "target" not in table:
        return None
    if procedure != "balance":
        raise table.fail("target", "is of a balancing", 'say procedure = "balance", or remove it')
    target = table.number("target", low=0.0, unit="N m")
    if target == 0.0:
        raise table.fail("target", "is 0 N m", "give a torque above zero")
    return target


def _gains(table: Table, arms: Sequence[Arm], procedure: Procedure) -> tuple[Factor, ...]:
    if "gains" not in table:
        return ()
    own = table.table("gains")
    if procedure == "balance":
        raise table.fail("gains", "are of a law", "a balancing has its own: leave them out")
    found: list[Factor] = []
    for name in own.keys:
        unit = ""
        for arm in arms:
            units = gain_fields(load_controller(arm.controller, arm.gains))
            if name not in units:
                hint = UnknownName("gain", name, units).hint
                raise own.fail(name, f"is no gain of {arm.controller}", hint)
            if name in arm.gains:
                raise own.fail(name, f"is given by the arm {arm.name!r} too", "give it once")
            unit = units[name]
        (spread,) = read_values(own, name, 1, unit=unit)
        for end in spread.ends:
            if math.isfinite(end):
                for arm in arms:
                    load_controller(arm.controller, {**arm.gains, name: end})
        found.append(Factor(f"gains.{name}", unit, spread))
    own.close()
    return tuple(found)


def _metrics(table: Table, key: str, known: Sequence[str]) -> tuple[str, ...]:
    names = table.texts(key, tuple(known))
    if not names:
        raise table.fail(key, "is empty", "name some, or leave it out for all")
    for name in names:
        if name not in METRICS:
            hint = UnknownName("metric", name, known).hint
            raise table.fail(key, f"holds {name!r}, no metric we know", hint)
        if name not in known:
            raise table.fail(
                key,
                f"holds {name!r}, which this campaign does not have",
                f"known: {', '.join(known)}",
            )
    return tuple(dict.fromkeys(names))


def _keep(table: Table, runs: int, metrics: Sequence[str]) -> Keep:
    if "keep" not in table:
        return Keep()
    own = table.table("keep")
    numbers: tuple[int, ...] = ()
    if "runs" in own:
        given = own.numbers("runs", None, low=0, high=runs - 1)
        if any(number != int(number) for number in given):
            raise own.fail("runs", f"is {own.raw('runs')!r}", "give whole numbers of runs")
        numbers = tuple(sorted({int(number) for number in given}))
    worst = own.whole("worst", 0, low=0, high=1000)
    if worst > runs:
        raise own.fail("worst", f"is {worst}", f"the campaign has {runs} runs")
    if worst and "by" not in own:
        raise own.fail("worst", "are worst by no metric", f'say by which: by = "{metrics[0]}"')
    if not worst and "by" in own:
        raise own.fail("by", "says by what, and not how many", "add worst = 10, say, or remove it")
    by = own.text("by", "")
    if by and by not in metrics:
        hint = UnknownName("metric", by, metrics).hint
        raise own.fail("by", f"is {by!r}, no metric of this campaign", hint)
    own.close()
    return Keep(numbers, worst, by)


def _refuse_odd(table: Table, spec: Spec) -> None:
    """What no single key is to blame for."""
    if spec.runs % spec.points:
        fits = max(round(spec.runs / spec.points), 1) * spec.points
        raise table.fail(
            "runs",
            f"is {spec.runs}, no multiple of the {spec.points} combinations of arms and grids",
            f"give {fits}, so that every sample flies each",
        )
    dispersed = [factor.name for factor in spec.dispersed]
    if spec.sampling == "grid" and dispersed:
        raise table.fail(
            "sampling",
            f"is 'grid', but {dispersed[0]} is spread by a distribution",
            "put it on a grid, or sample it: random, latin_hypercube or sobol",
        )
    if spec.sampling == "saltelli":
        _refuse_odd_design(table, spec)


def _refuse_odd_design(table: Table, spec: Spec) -> None:
    if spec.grids:
        raise table.fail(
            "sampling",
            f"is 'saltelli', but {spec.grids[0][0].name} is on a grid",
            "spread it by a distribution, or make its values arms",
        )
    if not spec.dispersed:
        raise table.fail(
            "sampling", "is 'saltelli', but nothing is spread", "spread some, or use random"
        )
    of_one = spec.points * spec.together
    number = spec.runs / of_one
    if number < 2 or not math.log2(number).is_integer():
        fits = of_one * 2 ** max(round(math.log2(max(number, 1e-9))), 1)
        raise table.fail(
            "runs",
            f"is {spec.runs}; a Saltelli design of {len(spec.dispersed)} factors has "
            f"{of_one} runs for each of 2, 4, 8, ... points",
            f"give {fits}; 256 points, {256 * of_one} runs, are a usual beginning",
        )
