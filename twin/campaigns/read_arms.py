"""The ways that a campaign compares, with their machines, laws and effects."""

from collections.abc import Mapping
from dataclasses import Field, fields, replace
from typing import Any, cast

from twin.campaigns.distribution import Fixed
from twin.campaigns.read_values import read_values, usual
from twin.campaigns.spec import Arm, DispersedEffect, Factor, Procedure
from twin.config import Table
from twin.controller import AnyController, load_controller
from twin.effects import Effect, effect_named, effects_of, with_effects
from twin.errors import CampaignError, TwinError
from twin.estimators import load_estimator, usual_estimator
from twin.plant.each import cannot_differ
from twin.platform import Platform, load_platform
from twin.procedures import WAYS, balancing, usual_target
from twin.reference import parse_reference

_OWN = ("name", "platform", "controller", "estimator", "reference", "gains")
"""What an arm may have otherwise than the campaign."""


def read_arms(table: Table, procedure: Procedure, target: float | None) -> tuple[Arm, ...]:
    """The arms of [[arms]], or the one of a campaign without.

    Raises:
        CampaignError: parts that are unknown, or do not fit together.
    """
    rows = table.tables("arms")
    for row in rows:
        for key in row.keys:
            if key not in _OWN:
                raise row.fail(key, "is no key of an arm", "an arm has " + ", ".join(_OWN))
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
    gains = _gains(row) if row is not table else {}
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


def _gains(row: Table) -> Mapping[str, float]:
    if "gains" not in row:
        return {}
    table = row.table("gains")
    return {key: table.number(key) for key in table.keys}


def _effects(table: Table, platform: Platform) -> tuple[DispersedEffect, ...]:
    """Those that the platform states and the specification does not, then the specification's."""
    given = _given(table.table("effects", required=False))
    labels = [_label(effect) for effect in given]
    own = [_as_stated(effect) for effect in effects_of(platform) if effect.label not in labels]
    return (*own, *given)


def _given(table: Table) -> list[DispersedEffect]:
    found: list[DispersedEffect] = []
    for name in table.keys:
        kind = _named(table, name, effect_named, name)
        inner = table.table(name)
        known = {one.name for one in (*kind.parameters(), *kind.settings())}
        shown = table.table(name)  # what is only looked at counts as asked for
        aims = [key for key in inner.keys if key not in known and isinstance(shown.raw(key), dict)]
        if kind.takes and aims:
            found += [_dispersed(name, kind, aim, inner.table(aim)) for aim in aims]
            inner.close()
        else:
            found.append(_dispersed(name, kind, "", inner))
    return found


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
        factors += [Factor(f"{stem}.{name}", known.unit, one) for name, one in pairs]
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
            one = effect.at({})
            whole = with_effects(whole, [one])
            differs = any(not isinstance(f.distribution, Fixed) for f in effect.factors)
            why = cannot_differ(one, bare) if differs else ""
        except TwinError as problem:
            raise _about(table, effect, str(problem)) from None
        if why:
            raise _about(table, effect, f"{why}; give it one value")
    return whole


def _about(table: Table, effect: DispersedEffect, said: str) -> CampaignError:
    sentence, told, remedy = said.rpartition("; ")
    inner = table.table("effects", required=False)
    problem = inner.fail(
        effect.kind.name, f"cannot be: {sentence or said}", remedy if told else "remove it"
    )
    return cast(CampaignError, problem)


def _label(effect: DispersedEffect) -> str:
    return f"{effect.kind.name}:{effect.target}" if effect.target else effect.kind.name


def _among(names: Mapping[str, Any]) -> str:
    return ", ".join(map(repr, names))


def _named(table: Table, key: str, find: Any, name: str) -> Any:
    """What a name stands for; what is wrong about it is said with the key's line."""
    try:
        return find(name)
    except CampaignError:
        raise
    except TwinError as problem:
        said, _, remedy = str(problem).rpartition("; ")
        raise table.fail(
            key, f"is {name!r}: {said or problem}", remedy if said else "change it"
        ) from None
