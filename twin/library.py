"""Where machines and control laws are, and what installed packages add to the library by name.

An installed package adds to the library by entry points, all in the same way; `twin` finds each by
the entry point's name:

- `twin.controllers`: the class of a control law, the only law in its file;
- `twin.effects`: the class of an effect;
- `twin.devices`: the class of a device's settings, a name for `kind` in `[hardware.devices]`;
- `twin.procedures`: a `twin.procedures.Way`, a name for `twin balance --procedure`;
- `twin.readers`: a function that reads a file, under the ending of its name without the dot.
"""

import inspect
import os
from collections.abc import Callable, Iterator, Mapping
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, TypeVar

from twin.errors import UnknownName, UsageError

_PACKAGE = Path(__file__).parent
_LAWS = "twin.controllers"

Entry = TypeVar("Entry")


class Registry(Mapping[str, Entry]):
    """Entries by name: those built in, then those of installed packages, which are imported when
    they are asked for."""

    def __init__(
        self, group: str, built_in: Mapping[str, Entry], entry_of: Callable[[Any], Entry | None]
    ) -> None:
        """Nothing is imported yet.

        Args:
            group: of the entry points.
            built_in: entries by name; an entry point of such a name is ignored.
            entry_of: the entry that an imported object makes; None of an object that makes none.
        """
        self._group, self._built_in, self._entry_of = group, built_in, entry_of

    def __getitem__(self, name: str) -> Entry:
        """The entry of that name.

        Raises:
            KeyError: there is none.
            UsageError: a package's entry point fails.
        """
        if name in self._built_in:
            return self._built_in[name]
        for point in entry_points(group=self._group, name=name):
            entry = self._entry_of(_loaded(point))
            if entry is None:
                raise UsageError(f"{_described(point)} names no object that this group takes")
            return entry
        raise KeyError(name)

    def __contains__(self, name: object) -> bool:
        return name in set(self)

    def __iter__(self) -> Iterator[str]:
        yield from self._built_in
        names = {point.name for point in entry_points(group=self._group)}
        yield from sorted(names - self._built_in.keys())

    def __len__(self) -> int:
        return len(list(iter(self)))


def library(kind: str) -> Path:
    """The folder of shipped `models` or `controllers`."""
    inside = _PACKAGE / kind
    return inside if inside.is_dir() else _PACKAGE.parent / kind


def model_names() -> list[str]:
    """Names of the shipped platforms."""
    return sorted(path.parent.name for path in library("models").glob("*/platform.toml"))


def controller_names() -> list[str]:
    """Names of the shipped control laws, then of those of installed packages."""
    shipped = sorted(path.stem for path in library("controllers").glob("*.py"))
    return [*shipped, *sorted(point.name for point in entry_points(group=_LAWS))]


def find_model(name: str) -> tuple[Path, str]:
    """Folder and variant of `sads`, `sads:table1`, `path/to/folder` or `path/to/folder:variant`.

    Raises:
        UnknownName: neither a shipped platform nor a folder with a platform.toml.
        UsageError: a folder of this name lies here, and a shipped platform has it too.
    """
    for stem, variant in ((name, ""), _split(name)):
        folder = Path(stem)
        _check_alone(stem, folder)
        if (folder / "platform.toml").is_file():
            return folder.resolve(), variant
        if folder.name == "platform.toml" and folder.is_file():
            return folder.parent.resolve(), variant
        shipped = library("models") / stem
        if stem and stem == shipped.name and (shipped / "platform.toml").is_file():
            return shipped, variant
    raise UnknownName("platform", name, model_names())


def _check_alone(stem: str, folder: Path) -> None:
    """Refuse a bare name that a shipped machine and a folder of somebody's share."""
    shipped = library("models") / stem
    both = stem == shipped.name and all(
        (each / "platform.toml").is_file() for each in (folder, shipped)
    )
    if stem and both and not folder.samefile(shipped):
        raise UsageError(
            f"{stem!r} is a shipped machine, and a folder here; say .{os.sep}{stem} for the "
            f"folder, or {shipped} for the other"
        )


def findable(folder: Path, name: str) -> str:
    """What `find_model` finds: of a shipped platform its name, of any other its folder."""
    stem, _, variant = name.partition(":")
    if library("models") / stem == folder:
        return name
    return f"{folder}:{variant}" if variant else str(folder)


def find_controller(name: str) -> Path:
    """File of a control law: shipped (`quaternion_pd`), of an installed package, or one's own
    (`path/to/law.py`).

    Raises:
        UnknownName: none of these.
        UsageError: it ends in .py, and there is no such file; or a package's entry point fails.
    """
    own = Path(name)
    if own.suffix == ".py":
        if not own.is_file():
            raise UsageError(f"{name}: there is no such file; check the path")
        return own.resolve()
    shipped = library("controllers") / f"{name}.py"
    if name == shipped.stem and shipped.is_file():
        return shipped
    for point in entry_points(group=_LAWS, name=name):
        return _file_of(point)
    raise UnknownName("controller", name, controller_names())


def _file_of(point: EntryPoint) -> Path:
    """The file of the class that an entry point names."""
    law = _loaded(point)
    try:
        return Path(inspect.getfile(law)).resolve()
    except (TypeError, OSError) as problem:
        raise UsageError(f"{_described(point)} names no class of a file: {problem}") from None


def _loaded(point: EntryPoint) -> Any:
    try:
        return point.load()
    except Exception as problem:
        raise UsageError(
            f"{_described(point)} cannot be imported: {type(problem).__name__}: {problem}; correct "
            "the package that brings it, or remove it"
        ) from problem


def _described(point: EntryPoint) -> str:
    return f"entry point {point.name!r} of {point.group!r} ({point.value})"


def _split(name: str) -> tuple[str, str]:
    stem, _, variant = name.rpartition(":")
    return stem, variant
