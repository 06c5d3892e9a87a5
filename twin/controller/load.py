"""A control law from its file: by name or path, imported alone, with its gains."""

import inspect
import math
import traceback
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from types import ModuleType
from typing import Any

from twin.controller.controller import AnyController, Controller
from twin.errors import ControllerError, TwinError, UnknownName
from twin.files import file_of, import_alone
from twin.library import find_controller, findable
from twin.platform import Platform


def load_controller(name: str, gains: Mapping[str, float] | None = None) -> AnyController:
    """The law of that name (`quaternion_pd`) or in that file (`path/to/law.py`), with its gains.

    Raises:
        UnknownName: no such law, or no such gain.
        UsageError: no such file.
        ControllerError: the file cannot be imported, does not define exactly one law, or its class
            does not take the gains.
    """
    path = find_controller(name)
    law = _only_law(path, _imported(path))
    if not is_dataclass(law):
        raise ControllerError(
            f"{path}: {law.__name__} is no dataclass; put @dataclass(frozen=True) above it and "
            "make its gains fields"
        )
    known = {field.name: field for field in fields(law) if field.init}
    given = dict(gains or {})
    for gain, value in given.items():
        if gain not in known:
            raise UnknownName("gain", gain, known)
        _expect_number(path, known[gain], value)
    for gain, field in known.items():
        if gain not in given and field.default is MISSING and field.default_factory is MISSING:
            raise ControllerError(f"{path}: {called(gain)} has no default; give it a value")
    try:
        return law(**given)
    except TwinError:
        raise
    except Exception as problem:
        raise ControllerError(f"{path}: {raised_at(path, problem)}") from problem


def called(gain: str) -> str:
    """How a sentence names a gain: one of the name "gain" is no "gain gain"."""
    return gain if gain.split("_")[-1] == "gain" else f"gain {gain}"


def tell_mistake(law: AnyController, platform: Platform, problem: BaseException) -> None:
    """Say what a law's own file raised, and where, for its author; of what is no file, nothing.

    Args:
        law: that raised it.
        platform: on which it did, and on which the check will say more.
        problem: what was raised.

    Raises:
        ControllerError: file, line, kind and message.
    """
    path = file_of(type(law).__module__)
    if path is None and isinstance(problem, SystemExit):
        raise ControllerError(f"{type(law).__name__} raised SystemExit; a law ends by `finished`")
    if path is not None and not isinstance(problem, TwinError):
        raise ControllerError(
            f"{path}: {raised_at(path, problem)}; {_check_says_more(path, platform)}"
        ) from problem


def tell_refused(law: AnyController, platform: Platform, problem: TwinError) -> None:
    """Say whose file gave a command that the machine refuses; of what is no file, nothing.

    Args:
        law: whose command it is.
        platform: that refuses it.
        problem: why.

    Raises:
        ControllerError: file, line of its `update`, and what is refused.
    """
    path = file_of(type(law).__module__)
    if path is not None:
        code = type(law).update.__code__
        line = f"line {code.co_firstlineno}: " if code.co_filename == str(path) else ""
        raise ControllerError(
            f"{path}: {line}what update returns: {problem}; {_check_says_more(path, platform)}"
        ) from problem


def _check_says_more(path: Path, platform: Platform) -> str:
    return f"`twin check {path} --platform {findable(platform.folder, platform.name)}` says more"


def raised_at(path: Path, problem: BaseException) -> str:
    """Line of `path`, kind and message of what was raised in it."""
    lines = [
        frame.lineno
        for frame in traceback.extract_tb(problem.__traceback__)
        if frame.filename == str(path)
    ]
    line = problem.lineno if isinstance(problem, SyntaxError) else (lines[-1] if lines else None)
    message = problem.msg if isinstance(problem, SyntaxError) else str(problem)
    return (f"line {line}: " if line else "") + f"{type(problem).__name__}: {message}"


def _imported(path: Path) -> ModuleType:
    try:
        return import_alone(path)
    except (Exception, SystemExit) as problem:
        raise ControllerError(
            f"{path}: cannot be imported, {raised_at(path, problem)}; mend the file"
        ) from problem


def _only_law(path: Path, module: ModuleType) -> type[AnyController]:
    laws = [
        var
        for var in vars(module).values()
        if isinstance(var, type)
        and issubclass(var, Controller)
        and var.__module__ == module.__name__
    ]
    if len(laws) != 1:
        names = ", ".join(law.__name__ for law in laws) or "none"
        raise ControllerError(
            f"{path}: defines {len(laws)} subclasses of twin.controller.Controller ({names}); "
            "a law is a file with exactly one"
        )
    if inspect.isabstract(laws[0]):
        missing = ", ".join(sorted(laws[0].__abstractmethods__))
        raise ControllerError(f"{path}: {laws[0].__name__} lacks {missing}; add it")
    return laws[0]


def _expect_number(path: Path, field: "Field[Any]", value: object) -> None:
    unit = field.metadata.get("unit", "")
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ControllerError(
            f"{path}: {called(field.name)} is {value!r}; give a finite number"
            + (f" in {unit}" if unit else "")
        )
