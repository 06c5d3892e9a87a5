"""A specification from its TOML file: every mistake is a sentence before any run starts."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import Field, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.campaigns.distribution import (
    SAMPLINGS,
    Distribution,
    Fixed,
    GridValues,
    LogUniform,
    Normal,
    Sampling,
    Uniform,
)
from twin.campaigns.merit import METRICS, metric_names
from twin.campaigns.spec import (
    PARTS,
    SHARD,
    SMALLEST_SHARD,
    Arm,
    DispersedEffect,
    Factor,
    Initial,
    Keep,
    Procedure,
    Spec,
)
from twin.clock import LONGEST
from twin.config import Table, as_number, read_toml
from twin.controller import AnyController, load_controller
from twin.effects import Effect, Parameter, effect_named, effects_of, with_effects
from twin.errors import CampaignError, TwinError, UnknownName
from twin.estimators import load_estimator, usual_estimator
from twin.files import is_trusted
from twin.plant.each import cannot_differ
from twin.platform import Platform, load_platform
from twin.procedures import WAYS, balancing, usual_target
from twin.procedures.setup import REACH
from twin.reference import parse_reference

Array = NDArray[np.float64]

KINDS = ("uniform", "log_uniform", "normal", "grid")
"""Of distributions, by their keys."""

_SHAPES = {
    "uniform": "two values, lowest and highest",
    "log_uniform": "two values above 0, lowest and highest",
    "normal": "two values, mean and standard deviation",
}


def read_values(
    table: Table,
    key: str,
    size: int,
    *,
    low: float = -math.inf,
    high: float = math.inf,
    unit: str = "",
) -> tuple[Distribution, ...]:
    """The distribution of each of `size` components of a key.

    A number or a list is the same in all runs; `{ uniform = [low, high] }` and its like are spread,
    each component for itself. Low, high and the others are numbers or lists of `size`; a component
    of a vector that is left no room is the same in all runs.

    Args:
        table: that holds the key.
        key: is there.
        size: components.
        low: bound of every component; a normal distribution is cut off there.
        high: bound of every component.
        unit: of the values.

    Raises:
        CampaignError: no distribution, or values that do not fit.
    """
    if not isinstance(table.raw(key), dict):
        return tuple(map(Fixed, table.numbers(key, size, low=low, high=high, unit=unit).tolist()))
    spread = table.table(key)
    kinds = [kind for kind in KINDS if kind in spread]
    if len(kinds) != 1:
        said = " and ".join(kinds) or "no distribution"
        raise table.fail(key, f"has {said}", "give one of " + ", ".join(KINDS))
    (kind,) = kinds
    if kind == "grid":
        if size != 1:
            raise table.fail(key, "is a vector on a grid", "put a single number on a grid")
        values = spread.numbers(kind, None, low=low, high=high, unit=unit)
        if len(set(values.tolist())) < len(values):
            raise spread.fail(kind, "has a value twice", "give each once")
        result: tuple[Distribution, ...] = (GridValues(tuple(values.tolist())),)
    else:
        first, second = _pair(spread, kind, size)
        result = tuple(
            Fixed(a)
            if size > 1 and low <= a <= high and (b == 0.0 if kind == "normal" else a == b)
            else _distribution(spread, kind, a, b, (low, high), unit)
            for a, b in zip(first.tolist(), second.tolist(), strict=True)
        )
    spread.close()
    return result


def usual(known: Parameter) -> tuple[Distribution, ...]:
    """Default distribution of a parameter, one per component.

    An amplitude of either sign is normal about 0 with its typical size as standard deviation, one
    of a single sign uniform from 0 to twice its typical size; a shape stays as it typically is.
    """
    return tuple(_usual(known, value) for value in np.atleast_1d(known.typical).tolist())


def _usual(known: Parameter, typical: float) -> Distribution:
    if not known.amplitude or typical == 0.0:
        return Fixed(typical)
    if known.low < 0.0 < known.high:
        return Normal(0.0, abs(typical), known.low, known.high)
    return Uniform(*sorted((0.0, float(np.clip(2.0 * typical, known.low, known.high)))))


def _pair(spread: Table, kind: str, size: int) -> tuple[Array, Array]:
    given = spread.raw(kind)
    each = f", each a number or a list of {size}" if size > 1 else ""
    problem = spread.fail(kind, f"is {given!r}", f"give {_SHAPES[kind]}{each}, as in [1.0, 2.0]")
    if not isinstance(given, list) or len(given) != 2:
        raise problem
    ends: list[Array] = []
    for end in given:
        numbers = end if isinstance(end, list) else [end] * size
        if len(numbers) != size or not all(math.isfinite(as_number(x)) for x in numbers):
            raise problem
        ends.append(np.array(numbers, dtype=np.float64))
    return ends[0], ends[1]


def _distribution(
    spread: Table, kind: str, a: float, b: float, bounds: tuple[float, float], unit: str
) -> Distribution:
    low, high = bounds
    of = f" {unit}" if unit else ""
    if kind == "normal":
        if b <= 0.0:
            raise spread.fail(kind, f"has a standard deviation of {b:g}{of}", "give one above 0")
        if not low <= a <= high:
            raise spread.fail(kind, f"has a mean of {a:g}{of}", _within(low, high, of))
        return Normal(a, b, low, high)
    if not a < b:
        raise spread.fail(kind, f"goes from {a:g} to {b:g}{of}", "give the lower value first")
    for end in (a, b):
        if not low <= end <= high:
            raise spread.fail(kind, f"holds {end:g}{of}", _within(low, high, of))
    if kind == "uniform":
        return Uniform(a, b)
    if a <= 0.0:
        raise spread.fail(kind, f"begins at {a:g}{of}", "decades begin above 0")
    return LogUniform(a, b)


def _within(low: float, high: float, of: str) -> str:
    if math.isinf(high):
        return f"it must be at least {low:g}{of}"
    return f"it must lie between {low:g} and {high:g}{of}"


_PLAIN_KEYS = ("name", "platform", "controller", "estimator", "reference", "gains")
"""What an arm may have otherwise than the campaign."""


def read_arms(table: Table, procedure: Procedure, target: float | None) -> tuple[Arm, ...]:
    """The arms of [[arms]], or the one of a campaign without.

    Raises:
        CampaignError: parts that are unknown, or do not fit together.
    """
    rows = table.tables("arms")
    for row in rows:
        for key in row.keys:
            if key not in _PLAIN_KEYS:
                raise row.fail(key, "is no key of an arm", "an arm has " + ", ".join(_PLAIN_KEYS))
    sources = [(row, row.text("name")) for row in rows] or [(table, "")]
    names = [name for _, name in sources]
    for (row, name), count in zip(sources, map(names.count, names), strict=True):
        if count > 1:
            raise row.fail("name", f"{name!r} is that of {count} arms", "give each its own")
    arms = tuple(_arm(row, table, name, procedure, target) for row, name in sources)
    for (row, _), arm in zip(sources, arms, strict=True):
        if [e.label for e in effects_of(arm.platform)] != [
            e.label for e in effects_of(arms[0].platform)
        ]:
            raise row.fail(
                "platform",
                f"{arm.platform.name} states other effects than {arms[0].platform.name}",
                "name in [effects] what only one of them states, so that all have it",
            )
    for key in ("platform", "controller", "estimator", "reference"):
        table.raw(key)  # asked for, also where every arm has its own
    return arms


def _check_code(table: Table, key: str, name: str) -> None:
    """Refuse to run a file that only the specification names: somebody else may have written it.

    Raises:
        CampaignError: where it lies, and how to let it run.
    """
    path = Path(name)
    if path.suffix == ".py" and path.is_file() and not is_trusted(path):
        folder = path.resolve().parent
        raise table.fail(
            key,
            f"is {name!r}, Python code that would run with your rights",
            f"read it, then say --trust {folder}",
        )


def gain_fields(law: AnyController) -> dict[str, str]:
    """Units of a law's gains, by name."""
    known: tuple[Field[Any], ...] = fields(cast(Any, law))
    return {entry.name: entry.metadata.get("unit", "") for entry in known if entry.init}


def _arm(row: Table, table: Table, name: str, procedure: Procedure, target: float | None) -> Arm:
    def text(key: str, default: Any) -> str:
        source = row if key in row else table
        return source.text(key, default) if default is not None else source.text(key)

    def owner(key: str) -> Table:
        return row if key in row else table

    machine = text("platform", None)
    platform = _named(owner("platform"), "platform", load_platform, machine)
    effects = _effects(table, platform)
    with_all = _with_effects(table, platform, effects)
    estimator = text("estimator", usual_estimator(platform))
    _named(owner("estimator"), "estimator", load_estimator, estimator)
    reference = text("reference", "")
    if reference:
        _named(owner("reference"), "reference", parse_reference, reference)
    torque = usual_target(platform) if target is None else target
    controller = text("controller", None)
    gains = _gains_of_arm(row) if row is not table else {}
    if procedure == "balance":
        if gains:
            raise row.fail("gains", "are of a law", "a balancing has its own: leave them out")
        source = owner("controller")
        if controller not in WAYS:
            raise source.fail(
                "controller", f"is {controller!r}, no way of balancing", f"use {_among(WAYS)}"
            )

        def begun(way: str) -> object:
            return balancing(platform, 2, way=way, target=torque, workers=0)

        _named(source, "controller", begun, controller)
    else:
        source = owner("controller")
        _check_code(source, "controller", controller)

        def loaded(law: str) -> AnyController:
            return load_controller(law, gains)

        law = _named(source, "controller", loaded, controller)
        _named(source, "controller", lambda _: law.init(with_all, 2), controller)
    _named(
        owner("estimator"), "estimator", lambda e: load_estimator(e).init(with_all, 2), estimator
    )
    return Arm(
        name=name or controller,
        machine=machine,
        platform=with_all,
        known=platform,
        controller=controller,
        target=torque if procedure == "balance" else 0.0,
        gains=gains,
        estimator=estimator,
        reference=reference,
        effects=effects,
    )


def _gains_of_arm(row: Table) -> Mapping[str, float]:
    if "gains" not in row:
        return {}
    table = row.table("gains")
    return {key: table.number(key) for key in table.keys}


def _effects(table: Table, platform: Platform) -> tuple[DispersedEffect, ...]:
    """Those that the platform states and the specification does not, then the specification's."""
    given = _given(table.table("effects", required=False))
    labels = [_label(effect) for effect in given]
    stated = [_as_stated(effect) for effect in effects_of(platform) if effect.label not in labels]
    return (*stated, *given)


def _given(table: Table) -> list[DispersedEffect]:
    effects: list[DispersedEffect] = []
    for name in table.keys:
        _check_code(table, name, name)
        kind = _named(table, name, effect_named, name)
        inner = table.table(name)
        known = {parameter.name for parameter in (*kind.parameters(), *kind.settings())}
        shown = table.table(name)  # what is only looked at counts as asked for
        aims = [key for key in inner.keys if key not in known and isinstance(shown.raw(key), dict)]
        if kind.takes and aims:
            effects += [_dispersed(name, kind, aim, inner.table(aim)) for aim in aims]
            inner.close()
        else:
            effects.append(_dispersed(name, kind, "", inner))
    return effects


def _dispersed(called: str, kind: type[Effect], target: str, table: Table) -> DispersedEffect:
    factors: list[Factor] = []
    stem = f"effects.{kind.name}" + (f".{target}" if target else "")
    for known in kind.parameters():
        spread = (
            read_values(
                table, known.name, known.size, low=known.low, high=known.high, unit=known.unit
            )
            if known.name in table
            else usual(known)
        )
        pairs = zip(known.names, spread, strict=True)
        factors += [Factor(f"{stem}.{name}", known.unit, item) for name, item in pairs]
    names = [entry.name for entry in kind.settings()]
    settings = {name: _setting(table.raw(name)) for name in names if name in table}
    for known in kind.parameters():
        table.raw(known.name)  # those that are not given are known, too
    table.close()
    return DispersedEffect(called, kind, target, settings, tuple(factors))


def _setting(value: Any) -> Any:
    return tuple(cast(list[Any], value)) if isinstance(value, list) else value


def _as_stated(effect: Effect) -> DispersedEffect:
    stem = f"effects.{effect.name}" + (f".{effect.target}" if effect.target else "")
    units = [known.unit for known in effect.parameters() for _ in known.names]
    rows = zip(effect.names, units, effect.values.tolist(), strict=True)
    factors = tuple(Factor(f"{stem}.{name}", unit, Fixed(v)) for name, unit, v in rows)
    settings = {entry.name: getattr(effect, entry.name) for entry in effect.settings()}
    return DispersedEffect(effect.name, type(effect), effect.target, settings, factors)


def _with_effects(
    table: Table, platform: Platform, effects: tuple[DispersedEffect, ...]
) -> Platform:
    """The platform with all of them at their middle, refused where it cannot have one."""
    bare = replace(platform, effects=())
    whole = bare
    for effect in effects:
        try:
            item = effect.at({})
            whole = with_effects(whole, [item])
            differs = any(not isinstance(f.distribution, Fixed) for f in effect.factors)
            why = cannot_differ(item, bare) if differs else ""
        except TwinError as problem:
            raise _about(table, effect, str(problem)) from None
        if why:
            raise _about(table, effect, f"{why}; give it one value")
    return whole


def _about(table: Table, effect: DispersedEffect, said: str) -> CampaignError:
    sentence, separator, remedy = said.rpartition("; ")
    inner = table.table("effects", required=False)
    problem = inner.fail(
        effect.kind.name, f"cannot be: {sentence or said}", remedy if separator else "remove it"
    )
    return cast(CampaignError, problem)


def _label(effect: DispersedEffect) -> str:
    return f"{effect.kind.name}:{effect.target}" if effect.target else effect.kind.name


def _among(names: Mapping[str, Any]) -> str:
    return ", ".join(map(repr, names))


def _named(table: Table, key: str, find: Any, name: str) -> Any:
    """The factor of that name; an error names the line of the key."""
    try:
        return find(name)
    except CampaignError:
        raise
    except TwinError as problem:
        said, _, remedy = str(problem).rpartition("; ")
        raise table.fail(
            key, f"is {name!r}: {said or problem}", remedy if said else "change it"
        ) from None


_XYZ = ("x", "y", "z")
_ANGLES = ("roll", "pitch", "yaw")

_ALLOWED = {
    "attitude": "the tilt stop allows {} (angles are in radians)",
    "stage_position": "its travel is {}",
    "wheel_speed": "its speeds are {}",
}

Row = tuple[str, tuple[str, ...]]


def known_starts(platform: Platform) -> dict[str, Row]:
    """What can be given of a start on that platform: unit and components, by key."""
    rows: dict[str, Row] = {"center_of_mass_offset": ("kg m", _XYZ)}
    if platform.base.kind == "hinge":
        rows |= {"joint_angle": ("rad", ("",)), "joint_rate": ("rad/s", ("",))}
    else:
        rows |= {"attitude": ("rad", _ANGLES), "rate": ("rad/s", _XYZ)}
    if platform.base.travels:
        rows["velocity"] = ("m/s", _XYZ)
    if platform.wheels:
        rows["wheel_speed"] = ("rad/s", tuple(wheel.name for wheel in platform.wheels))
    if platform.stages:
        rows["stage_position"] = ("m", tuple(stage.name for stage in platform.stages))
    if platform.gimbals:
        rows["gimbal_angle"] = ("rad", tuple(gimbal.name for gimbal in platform.gimbals))
    return rows


def read_initial(table: Table, arms: Sequence[Arm]) -> Initial:
    """The table [initial]; at rest and level without.

    Raises:
        CampaignError: keys or values that no such machine can start from.
    """
    section = table.table("initial", required=False)
    platform = arms[0].platform
    rows = known_starts(platform)
    hangs = section.raw("hangs", False)
    if not isinstance(hangs, bool):
        raise section.fail("hangs", f"is {hangs!r}", "give true or false")
    if hangs and platform.base.kind != "ball":
        raise section.fail("hangs", f"is true, but {platform.name} hangs on no ball", "remove it")
    factors: dict[str, tuple[Factor, ...]] = {}
    reach = isinstance(section.raw("center_of_mass_offset"), str)
    for key, (unit, names) in rows.items():
        # asked of every key, so that one that is misspelt is told which it may have meant
        if section.raw(key) is None or (key == "center_of_mass_offset" and reach):
            continue
        spread = read_values(section, key, len(names), unit=unit)
        bounds = _bounds(platform, key, hangs=hangs)
        if bounds:
            spread = tuple(
                _held(section, key, name, item, ends, unit)
                for name, item, ends in zip(names, spread, bounds, strict=True)
            )
        factors[key] = tuple(
            Factor(f"initial.{key}" + (f".{name}" if name else ""), unit, item)
            for name, item in zip(names, spread, strict=True)
        )
    if reach:
        section.text("center_of_mass_offset", among=("within_reach",))
        if not platform.stages:
            raise section.fail(
                "center_of_mass_offset", "is what masses reach, of which there are none", "give m r"
            )
        factors["center_of_mass_offset"] = tuple(
            Factor(f"initial.reach.{stage.name}", "1", Uniform(-REACH, REACH))
            for stage in platform.stages
        )
    section.close()
    return Initial(factors, hangs, reach)


def _bounds(platform: Platform, key: str, *, hangs: bool) -> list[tuple[float, float]]:
    """Lower and upper bounds of each component of a start that the machine imposes."""
    if key == "attitude" and platform.base.kind == "ball" and math.isfinite(platform.stop_angle):
        # what hangs at the stop may begin at the other side's
        highest = min((2.0 if hangs else 1.0) * platform.stop_angle, math.pi)
        every = (-math.inf, math.inf)
        tilted = (-highest, highest)
        if platform.pitch_stop is not None:
            return [every, every, every]
        return [tilted, tilted, every]
    if key == "stage_position":
        return [stage.travel for stage in platform.stages]
    if key == "wheel_speed":
        return [(-wheel.speed_limit, wheel.speed_limit) for wheel in platform.wheels]
    return []


def _held(
    table: Table,
    key: str,
    name: str,
    distribution: Distribution,
    ends: tuple[float, float],
    unit: str,
) -> Distribution:
    """The distribution, refused beyond the ends; a normal one is cut off there."""
    low, high = ends
    lowest, highest = distribution.ends
    if isinstance(distribution, Normal):
        # what is cut off should be its tails
        lowest, highest = (
            distribution.mean - distribution.deviation,
            distribution.mean + distribution.deviation,
        )
    for value in (lowest, highest):
        if not low <= value <= high:
            raise table.fail(
                key,
                f"goes to {value:.4g} {unit} in {name}",
                _ALLOWED[key].format(f"{low:.4g} to {high:.4g} {unit}"),
            )
    return (
        replace(distribution, low=low, high=high)
        if isinstance(distribution, Normal)
        else distribution
    )


LARGEST = 10**9
"""Runs of a campaign; a Sobol sequence ends at 2^30 samples."""

LARGEST_SEED = 2**53
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
    if seed > LARGEST_SEED:
        raise table.fail("seed", f"is {seed}", f"give {LARGEST_SEED} at most")
    sampling = cast(Sampling, table.text("sampling", "random", among=SAMPLINGS))
    runs = table.whole("runs", low=1, high=LARGEST)
    usual = min(SHARD, max(SMALLEST_SHARD[procedure], -(-runs // PARTS)))
    shard = table.whole("shard", usual, low=2, high=1 << 16)
    target = _target(table, procedure)
    arms = read_arms(table, procedure, target)
    tick = max(arm.platform.tick for arm in arms)
    if duration < tick:
        raise table.fail("duration", f"is {duration:g} s", f"give a tick of {tick:g} s at least")
    gains = _gain_factors(table, arms, procedure)
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
    """Refuse unknown keys first: a misspelt key would seem to be missing."""
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


def _gain_factors(table: Table, arms: Sequence[Arm], procedure: Procedure) -> tuple[Factor, ...]:
    if "gains" not in table:
        return ()
    section = table.table("gains")
    if procedure == "balance":
        raise table.fail("gains", "are of a law", "a balancing has its own: leave them out")
    factors: list[Factor] = []
    for name in section.keys:
        unit = ""
        for arm in arms:
            units = gain_fields(load_controller(arm.controller, arm.gains))
            if name not in units:
                hint = UnknownName("gain", name, units).hint
                raise section.fail(name, f"is no gain of {arm.controller}", hint)
            if name in arm.gains:
                raise section.fail(name, f"is given by the arm {arm.name!r} too", "give it once")
            unit = units[name]
        (spread,) = read_values(section, name, 1, unit=unit)
        for end in spread.ends:
            if math.isfinite(end):
                for arm in arms:
                    load_controller(arm.controller, {**arm.gains, name: end})
        factors.append(Factor(f"gains.{name}", unit, spread))
    section.close()
    return tuple(factors)


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
    section = table.table("keep")
    numbers: tuple[int, ...] = ()
    if "runs" in section:
        given = section.numbers("runs", None, low=0, high=runs - 1)
        if any(number != int(number) for number in given):
            raise section.fail("runs", f"is {section.raw('runs')!r}", "give whole numbers of runs")
        numbers = tuple(sorted({int(number) for number in given}))
    worst = section.whole("worst", 0, low=0, high=1000)
    if worst > runs:
        raise section.fail("worst", f"is {worst}", f"the campaign has {runs} runs")
    if worst and "by" not in section:
        raise section.fail("worst", "are worst by no metric", f'say by which: by = "{metrics[0]}"')
    if not worst and "by" in section:
        raise section.fail(
            "by", "says by what, and not how many", "add worst = 10, say, or remove it"
        )
    by = section.text("by", "")
    if by and by not in metrics:
        hint = UnknownName("metric", by, metrics).hint
        raise section.fail("by", f"is {by!r}, no metric of this campaign", hint)
    section.close()
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
    per_sample = spec.points * spec.together
    number = spec.runs / per_sample
    if number < 2 or not math.log2(number).is_integer():
        fits = per_sample * 2 ** max(round(math.log2(max(number, 1e-9))), 1)
        raise table.fail(
            "runs",
            f"is {spec.runs}; a Saltelli design of {len(spec.dispersed)} factors has "
            f"{per_sample} runs for each of 2, 4, 8, ... points",
            f"give {fits}; 256 points, {256 * per_sample} runs, are a usual beginning",
        )
