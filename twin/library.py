"""Where machines and control laws lie: beside the package, in it in a wheel, or in other packages.

An installed package may bring control laws: each an entry point of the group `twin.controllers`
that names the law's class, the only law in its file.
"""

import inspect
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any

from twin.errors import UnknownName, UsageError

_PACKAGE = Path(__file__).parent
_GROUP = "twin.controllers"


def library(kind: str) -> Path:
    """The folder of shipped `models` or `controllers`."""
    inside = _PACKAGE / kind
    return inside if inside.is_dir() else _PACKAGE.parent / kind


def reproduction_file() -> Path:
    """What the papers published and when ours agrees; see `twin.reproduce`."""
    inside = _PACKAGE / "reproduce" / "reproduction.toml"
    return inside if inside.is_file() else _PACKAGE.parent / "docs" / "reproduction.toml"


def model_names() -> list[str]:
    """Names of the shipped platforms."""
    return sorted(path.parent.name for path in library("models").glob("*/platform.toml"))


def controller_names() -> list[str]:
    """Names of the shipped control laws, then of those of installed packages."""
    shipped = sorted(path.stem for path in library("controllers").glob("*.py"))
    return [*shipped, *sorted(point.name for point in entry_points(group=_GROUP))]


def find_model(name: str) -> tuple[Path, str]:
    """Folder and variant of `sads`, `sads:table1`, `path/to/folder` or `path/to/folder:variant`.

    Raises:
        UnknownName: neither a shipped platform nor a folder with a platform.toml.
    """
    for stem, variant in ((name, ""), _split(name)):
        folder = Path(stem)
        if (folder / "platform.toml").is_file():
            return folder.resolve(), variant
        if folder.name == "platform.toml" and folder.is_file():
            return folder.parent.resolve(), variant
        shipped = library("models") / stem
        if stem and stem == shipped.name and (shipped / "platform.toml").is_file():
            return shipped, variant
    raise UnknownName("platform", name, model_names())


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
    for point in entry_points(group=_GROUP, name=name):
        return _file_of(point)
    raise UnknownName("controller", name, controller_names())


def _file_of(point: EntryPoint) -> Path:
    """The file of the class that an entry point names."""
    try:
        law: Any = point.load()
        return Path(inspect.getfile(law)).resolve()
    except Exception as problem:
        raise UsageError(
            f"entry point {point.name!r} of {_GROUP!r} ({point.value}) names no class of a file: "
            f"{type(problem).__name__}: {problem}"
        ) from problem


def _split(name: str) -> tuple[str, str]:
    stem, _, variant = name.rpartition(":")
    return stem, variant
