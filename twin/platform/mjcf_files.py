"""What an MJCF file refers to, looked at before MuJoCo opens any of it.

A platform folder may come from anywhere, so its MJCF may name no file outside that folder and
declare no document type: entities, which nobody needs in MJCF, can grow without bound.
"""

from collections.abc import Mapping
from pathlib import Path
from xml.parsers import expat

from twin.errors import PlatformError

_FOLDERS = ("assetdir", "meshdir", "texturedir")
"""Attributes of <compiler> that files are looked for in."""
_MODELS = ("include", "model")
"""Elements whose file is MJCF again."""


def check_files(path: Path) -> tuple[bytes, ...]:
    """Follow an MJCF file and all that it includes; what stands in them.

    Raises:
        PlatformError: a document type, XML that is not well formed, or a file outside the folder
            of `path`, with its line.
    """
    seen: dict[Path, bytes] = {}
    _check(path, path.parent.resolve(), seen)
    return tuple(seen.values())


def _check(path: Path, folder: Path, seen: dict[Path, bytes]) -> None:
    if path.resolve() in seen or not path.is_file():  # of a missing file MuJoCo tells
        return
    directories: set[str] = {""}
    files: list[tuple[int, str, str]] = []
    parser = expat.ParserCreate()

    def refuse_document_type(*_: object) -> None:
        raise PlatformError(
            path,
            "declares a document type, in which entities can grow without bound",
            "remove <!DOCTYPE ...>",
            line=parser.CurrentLineNumber,
        )

    def collect(element: str, attributes: Mapping[str, str]) -> None:
        line = parser.CurrentLineNumber
        if element == "compiler":
            named = [attributes[key] for key in _FOLDERS if key in attributes]
            directories.update(named)
            files.extend((line, "", name) for name in named)
        files.extend(
            (line, element, name) for key, name in attributes.items() if key.startswith("file")
        )

    parser.StartDoctypeDeclHandler = refuse_document_type
    parser.StartElementHandler = collect
    try:
        text = path.read_bytes()
        seen[path.resolve()] = text
        parser.Parse(text, True)
    except expat.ExpatError as problem:
        text = expat.ErrorString(problem.code)
        raise PlatformError(path, f"is no XML ({text})", "mend it", line=problem.lineno) from None
    except OSError as problem:
        raise PlatformError(
            path, f"cannot be read ({problem.strerror})", "check the path"
        ) from None
    for line, element, name in files:
        for directory in directories:
            target = folder / directory / name
            if not target.resolve().is_relative_to(folder):
                raise PlatformError(
                    path,
                    f"names {name!r}, which lies outside the platform's folder",
                    "copy it into the folder",
                    line=line,
                )
            if element in _MODELS:
                _check(target, folder, seen)
