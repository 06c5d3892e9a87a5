"""The MJCF as its file has it, after a look at the files that it names.

What an MJCF file refers to, looked at before MuJoCo opens any of it.
A platform folder may come from anywhere, so its MJCF may name no file outside that folder and
declare no document type: entities, which nobody needs in MJCF, can grow without bound.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from xml.parsers import expat

import mujoco
import numpy as np
from numpy.typing import NDArray

from twin.errors import PlatformError, TwinError

_FOLDERS = ("assetdir", "meshdir", "texturedir")
"""Attributes of <compiler> that files are looked for in."""
_MODELS = ("include", "model")
"""Elements whose file is MJCF again."""

LARGEST = 8 << 20
"""A larger MJCF is not read [bytes]; meshes have files of their own."""

_COPIES = 1000
"""Bodies that <replicate> may make, one within the other counted by their product; and <flexcomp>
and <composite> the points of."""

_GRID = 2000 * 2000
"""Points that an <hfield> or a <texture> may have."""

_GROWS = {
    "replicate": (("count",), _COPIES),
    "composite": (("count",), _COPIES),
    "flexcomp": (("count",), _COPIES),
    "hfield": (("nrow", "ncol"), _GRID),
    "texture": (("width", "height"), _GRID),
}
"""Elements from which MuJoCo makes more than stands in the file: attributes whose product counts,
and the most that it may be."""


def check_files(path: Path) -> tuple[bytes, ...]:
    """Follow an MJCF file and all that it includes; what stands in them.

    Raises:
        PlatformError: a document type, XML that is not well formed, or a file outside the folder
            of `path`, with its line.
    """
    visited: dict[Path, bytes] = {}
    _check(path, path.parent.resolve(), visited)
    return tuple(visited.values())


def _check(path: Path, folder: Path, visited: dict[Path, bytes]) -> None:
    if path.resolve() in visited or not path.exists():  # of a missing file MuJoCo tells
        return
    _check_regular(path, path)
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

    copies: list[int] = [1]

    def leave(element: str) -> None:
        if element == "replicate":
            copies.pop()

    def collect(element: str, attributes: Mapping[str, str]) -> None:
        line = parser.CurrentLineNumber
        if element in _GROWS:
            keys, most = _GROWS[element]
            size = _product(attributes, keys)
            if element == "replicate":
                size = min(size * copies[-1], _COPIES + 1)
                copies.append(size)
            if size > most:
                raise PlatformError(
                    path,
                    f"<{element}> makes more than {most} of what it makes",
                    "make fewer",
                    line=line,
                )
        if element == "compiler":
            named = [attributes[key] for key in _FOLDERS if key in attributes]
            directories.update(named)
            files.extend((line, "", name) for name in named)
        files.extend(
            (line, element, name) for key, name in attributes.items() if key.startswith("file")
        )

    parser.StartDoctypeDeclHandler = refuse_document_type
    parser.StartElementHandler = collect
    parser.EndElementHandler = leave
    try:
        with path.open("rb") as file:
            text = file.read(LARGEST + 1)
        if len(text) > LARGEST:
            raise PlatformError(path, "holds more than 8 MiB", "keep meshes in files of their own")
        visited[path.resolve()] = text
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
            if element and target.exists():
                _check_regular(target, path, line)
            if element in _MODELS:
                _check(target, folder, visited)


def _check_regular(target: Path, path: Path, line: int | None = None) -> None:
    """Refuse what is no file: to read a pipe is to wait for whoever writes into it."""
    if not target.is_file():
        raise PlatformError(path, f"{target.name} is no regular file", "put one there", line=line)


def _product(attributes: Mapping[str, str], keys: Sequence[str]) -> int:
    """Of the whole numbers in these attributes; what MuJoCo cannot read either counts as one."""
    size = 1
    for key in keys:
        for word in attributes.get(key, "").split():
            digits = word.lstrip("+")
            # a number of thousands of digits is more than any
            size *= (
                1 if not digits.isdecimal() else int(digits[:12]) if len(digits) < 12 else 10**12
            )
    return size


Array = NDArray[np.float64]
Edit = Callable[[mujoco.MjSpec], None]


def load_mjcf(
    path: Path,
    *,
    visuals: bool = True,
    without: Sequence[str] = (),
    edits: Sequence[Edit] = (),
) -> mujoco.MjModel:
    """Compile the file; without what is only seen, a step is a fifth cheaper.

    Args:
        path: of the MJCF.
        visuals: keep what is only seen.
        without: actuators to leave out, with the sites of their names that they act on.
        edits: changes to make before it is compiled.

    Raises:
        PlatformError: it names a file outside its folder or has a document type, or MuJoCo
            refuses it.
    """
    read = check_files(path)
    try:
        spec = _parsed(path, read, tuple(without)).copy()
        spec.compiler.discardvisual = not visuals
        for edit in edits:
            edit(spec)
        return spec.compile()
    except TwinError:
        raise
    except ValueError as problem:
        text = " ".join(str(problem).split())
        raise PlatformError(path, f"MuJoCo refuses it: {text}", "mend the MJCF") from None


@lru_cache(maxsize=8)
def _parsed(path: Path, read: tuple[bytes, ...], without: tuple[str, ...]) -> mujoco.MjSpec:
    """To be copied, not changed: parsing takes ten times as long as compiling, and a diagnosis
    compiles a machine some hundred times.

    Args:
        path: of the MJCF.
        read: what stands in it and in all that it includes, so that a changed file is parsed anew.
        without: see `load_mjcf`.
    """
    del read
    spec = mujoco.MjSpec.from_file(str(path))
    for name in without:
        spec.delete(spec.actuator(name))
        spec.delete(spec.site(name))
    return spec


@dataclass(frozen=True)
class MjcfLayout:
    """Where the MJCF has its named parts at qpos0, in room axes, which are the body's there."""

    axes: Mapping[str, Array]
    """Of every joint, (3,)."""
    anchors: Mapping[str, Array]
    """Of every joint, (3,) [m]."""
    carriers: Mapping[str, tuple[str, ...]]
    """The joints that carry a joint, the nearest first."""
    sites: Mapping[str, Array]
    """Of every site, (3,) [m]."""
    pushes: Mapping[str, Array]
    """Of every site that an actuator of its name acts on, (3,) its force per unit of control."""


def read_layout(path: Path) -> MjcfLayout:
    """Compile the file and look where its parts are.

    Raises:
        PlatformError: as `load_mjcf`.
    """
    model = load_mjcf(path)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    joints = {model.joint(i).name: i for i in range(model.njnt)}
    return MjcfLayout(
        axes={name: data.xaxis[i].copy() for name, i in joints.items()},
        anchors={name: data.xanchor[i].copy() for name, i in joints.items()},
        carriers={name: tuple(_carriers(model, i)) for name, i in joints.items()},
        sites={model.site(i).name: data.site_xpos[i].copy() for i in range(model.nsite)},
        pushes={
            model.actuator(i).name: data.site_xmat[site].reshape(3, 3) @ model.actuator_gear[i, :3]
            for i, site in enumerate(model.actuator_trnid[:, 0])
            if model.actuator_trntype[i] == mujoco.mjtTrn.mjTRN_SITE
            and model.site(site).name == model.actuator(i).name
        },
    )


def _carriers(model: mujoco.MjModel, joint: int) -> Iterator[str]:
    body = int(model.body_parentid[model.jnt_bodyid[joint]])
    while body > 0:
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        yield from (model.joint(first + i).name for i in reversed(range(count)))
        body = int(model.body_parentid[body])
