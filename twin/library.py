"""Where the shipped machines and control laws lie: beside the package, or in it in a wheel."""

from pathlib import Path

from twin.errors import UnknownName, UsageError

_PACKAGE = Path(__file__).parent


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
    """Names of the shipped control laws."""
    return sorted(path.stem for path in library("controllers").glob("*.py"))


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
    """File of a shipped control law (`quaternion_pd`) or of one's own (`path/to/law.py`).

    Raises:
        UnknownName: neither.
        UsageError: it ends in .py, and there is no such file.
    """
    own = Path(name)
    if own.suffix == ".py":
        if not own.is_file():
            raise UsageError(f"{name}: there is no such file; check the path")
        return own.resolve()
    shipped = library("controllers") / f"{name}.py"
    if name == shipped.stem and shipped.is_file():
        return shipped
    raise UnknownName("controller", name, controller_names())


def _split(name: str) -> tuple[str, str]:
    stem, _, variant = name.rpartition(":")
    return stem, variant
