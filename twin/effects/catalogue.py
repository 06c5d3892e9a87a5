"""Effects by name: those built in, by subject, and a lab's own by path or entry point.

A lab's own effect is a file with one class, given by its path, or the entry point of an installed
package in the group `twin.effects` that names such a class.
"""

import importlib
import inspect
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from twin.effects.effect import Effect, EffectError
from twin.errors import UnknownName
from twin.files import import_alone
from twin.library import Registry

_FOLDER = Path(__file__).parent
_SUBJECTS = ("body", "sensors", "wheels", "actuators", "floor")
_GROUP = "twin.effects"


def effect_names() -> list[str]:
    """Names of all effects: the built-in ones by subject, then those of installed packages."""
    return list(_registry())


def catalogue() -> tuple[type[Effect], ...]:
    """All effects."""
    return tuple(effect_named(name) for name in effect_names())


def effect_named(name: str, *, files_allowed: bool = True) -> type[Effect]:
    """The effect of that name, or in that file (`path/to/effect.py`).

    Raises:
        UnknownName: no such effect.
        EffectError: the file cannot be imported or does not define exactly one effect; or it is a
            file where only names will do.
    """
    if name.endswith(".py"):
        if not files_allowed:
            raise EffectError(
                f"{name!r} is a file; a platform runs no code of its own: install the effect as an "
                f"entry point of the group {_GROUP!r} and name it, or give the file to --effects"
            )
        path = Path(name)
        if not path.is_file():
            raise UnknownName("effect", name, effect_names())
        return _only_effect(path.resolve())
    registry = _registry()
    if name in registry:
        return registry[name]
    raise UnknownName("effect", name, effect_names())


def file_of(kind: type[Effect]) -> Path | None:
    """The file of an effect that somebody brought; none of one that is built in."""
    path = Path(inspect.getfile(kind)).resolve()
    return None if path.is_relative_to(_FOLDER.resolve()) else path


@cache
def _registry() -> Registry[type[Effect]]:
    modules = [importlib.import_module(f"twin.effects.{subject}") for subject in _SUBJECTS]
    built_in = {kind.name: kind for module in modules for kind in _effects_of(module)}
    return Registry(_GROUP, built_in, _effect_or_none)


def _effect_or_none(brought: Any) -> type[Effect] | None:
    return brought if isinstance(brought, type) and issubclass(brought, Effect) else None


@cache
def _only_effect(path: Path) -> type[Effect]:
    try:
        module = import_alone(path)
    except (Exception, SystemExit) as problem:
        raise EffectError(
            f"{path}: cannot be imported, {type(problem).__name__}: {problem}; mend the file"
        ) from problem
    effects = _effects_of(module)
    if len(effects) != 1:
        names = ", ".join(effect.__name__ for effect in effects) or "none"
        raise EffectError(
            f"{path}: defines {len(effects)} effects ({names}); an effect is a file with exactly "
            "one subclass of BodyEffect, SeriesEffect, ReadingEffect or ScatterEffect"
        )
    _check(path, effects[0])
    return effects[0]


def _effects_of(module: ModuleType) -> list[type[Effect]]:
    return [
        var
        for var in vars(module).values()
        if _effect_or_none(var) and var.__module__ == module.__name__
        if not var.__name__.startswith("_")
    ]


def _check(path: Path, effect: type[Effect]) -> None:
    """Refuse a class that lacks what the catalogue tells of an effect."""
    if inspect.isabstract(effect):
        missing = ", ".join(sorted(effect.__abstractmethods__))
        raise EffectError(f"{path}: {effect.__name__} lacks {missing}; add it")
    for needed in ("name", "domain", "observable", "streams"):
        if not hasattr(effect, needed):
            raise EffectError(f"{path}: {effect.__name__} lacks `{needed}`; add it to the class")
    if not effect.parameters():
        raise EffectError(
            f"{path}: {effect.__name__} has no parameter; declare one with "
            "twin.effects.parameter, and put @dataclass(frozen=True) above the class"
        )
