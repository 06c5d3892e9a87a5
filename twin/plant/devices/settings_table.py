"""A device's settings from their table: one key a field, read by its type."""

import types
from collections.abc import Mapping
from dataclasses import MISSING, Field, fields
from typing import Any, Literal, TypeVar, Union, cast, get_args, get_origin, get_type_hints

from twin.config import Table
from twin.errors import UnknownName, UsageError

Settings = TypeVar("Settings")


def read_settings(kind: type[Settings], table: Table, **given: Any) -> Settings:
    """Settings of a kind; what the table does not have keeps its usual value.

    Args:
        kind: a dataclass of numbers, flags, texts, pairs, and mappings of numbers.
        table: of the device; the caller closes it.
        given: fields that do not come from the table.

    Raises:
        FileError: a value of another type, one that is missing, or one that the device has not,
            with file and line.
    """
    hints = get_type_hints(kind)
    read = {
        entry.name: _value(table, entry, hints[entry.name])
        for entry in fields(cast(Any, kind))
        if entry.name not in given and (entry.name in table or _required(entry))
    }
    try:
        return kind(**given, **read)
    except (UsageError, UnknownName) as problem:
        first = next(iter(read), "kind")
        raise table.fail(first, f"and the keys beside it: {problem}", "correct it") from None


def _required(entry: Field[Any]) -> bool:
    return entry.default is MISSING and entry.default_factory is MISSING


def _value(table: Table, entry: Field[Any], hint: Any) -> Any:
    name, origin = entry.name, get_origin(hint)
    if origin in (Union, types.UnionType):
        hint = next(one for one in get_args(hint) if one is not type(None))
        origin = get_origin(hint)
    if origin is Literal:
        return table.text(name, among=get_args(hint))
    if origin is tuple:
        return tuple(table.numbers(name, len(get_args(hint))).tolist())
    if origin is not None and issubclass(origin, Mapping):
        return _mapping(table.table(name), *get_args(hint))
    if hint is bool:
        return _flag(table, name)
    if hint is int:
        return table.whole(name)
    return table.number(name) if hint is float else table.text(name)


def _mapping(table: Table, key_type: type, value_type: Any) -> dict[Any, Any]:
    """`1 = [2, 0]` where the values are pairs, `gyro = 100` where they are numbers."""
    found: dict[Any, Any] = {}
    for key in table.keys:
        try:
            name = key_type(key)
        except ValueError:
            raise table.fail(key, "is no number", "number its keys") from None
        if get_origin(value_type) is tuple:
            pair = table.numbers(key, len(get_args(value_type)))
            found[name] = tuple(round(one) for one in pair.tolist())
        else:
            found[name] = table.whole(key) if value_type is int else table.number(key)
    return found


def _flag(table: Table, key: str) -> bool:
    value = table.raw(key)
    if not isinstance(value, bool):
        raise table.fail(key, f"is {value!r}", "say true or false")
    return value
