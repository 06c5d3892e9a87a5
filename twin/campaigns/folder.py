"""The folder of a campaign: what is flown there, by whom, and which shards are done.

campaign.toml           the specification, as it was given
campaign.json           what its results depend on: files and versions
metrics/*.parquet       a shard each; written whole or not at all
recordings/*.rrd        of the runs that are kept
"""

import hashlib
import json
import os
import sys
import tomllib
from collections.abc import Generator, Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from twin.campaigns.spec import Spec
from twin.effects import file_of
from twin.errors import CampaignError
from twin.files import write_whole
from twin.library import find_controller
from twin.platform import files_of

if sys.platform != "win32":
    import fcntl

SPEC, FACTS, METRICS, RECORDINGS, LOCK = (
    "campaign.toml",
    "campaign.json",
    "metrics",
    "recordings",
    "lock",
)

_PACKAGES = ("airbearing-twin", "mujoco", "numpy", "scipy")
"""Those whose versions decide about bits."""
_FUNCTIONS = (np.sin, np.cos, np.tan, np.arcsin, np.arctan, np.exp, np.log1p, np.tanh, np.cbrt)
_ARGUMENTS = np.linspace(-0.999, 0.999, 1001)


class Folder:
    """Of one campaign."""

    def __init__(self, path: Path) -> None:
        """Nothing is written yet."""
        self.path = path

    @property
    def spec(self) -> Path:
        """The specification's copy."""
        return self.path / SPEC

    @property
    def begun(self) -> bool:
        """Whether it holds a campaign."""
        return (self.path / FACTS).is_file()

    def shard(self, number: int) -> Path:
        """The file of a shard."""
        return self.path / METRICS / f"shard-{number:07d}.parquet"

    def recording(self, run: int) -> Path:
        """The file of a recorded run."""
        return self.path / RECORDINGS / f"run-{run}.rrd"

    def missing(self, spec: Spec) -> list[int]:
        """Shards that are not done, ascending."""
        done = set(os.listdir(self.path / METRICS)) if (self.path / METRICS).is_dir() else set()
        return [n for n in range(spec.shards) if self.shard(n).name not in done]

    def begin(self, spec: Spec, *, resume: bool) -> None:
        """Make the folder, or continue in it.

        Raises:
            CampaignError: it holds something else, or this campaign and `resume` is false.
        """
        if self.begun:
            self._compare(spec, resume)
        else:
            self._refuse_strange()
            (self.path / METRICS).mkdir(parents=True, exist_ok=True)
            write_whole(self.spec, spec.text)
            write_whole(self.path / FACTS, json.dumps(_facts(spec), indent=2) + "\n")
        self.sweep()

    def sweep(self) -> None:
        """Remove partly written shards of processes that were killed; no shard may be in flight."""
        for part in (self.path / METRICS).glob(".*"):
            part.unlink(missing_ok=True)

    @contextmanager
    def owned(self) -> Generator[None]:
        """One process owns the folder.

        Raises:
            CampaignError: another one does, or it cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            file = (self.path / LOCK).open("wb")
        except OSError as problem:
            raise CampaignError(
                self.path, f"cannot be written ({problem.strerror})", "choose another folder"
            ) from None
        with file:
            if sys.platform != "win32":
                try:
                    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                except BlockingIOError:
                    raise CampaignError(
                        self.path, "is being flown by another process", "wait for it, or end it"
                    ) from None
            yield

    def _refuse_strange(self) -> None:
        known = {SPEC, METRICS, LOCK}
        others = sorted(name for name in os.listdir(self.path) if name.lstrip(".") not in known)
        others = [name for name in others if not name.startswith(f".{SPEC}")
                  and not name.startswith(f".{FACTS}")]  # fmt: skip
        if others:
            raise CampaignError(
                self.path, f"holds {others[0]!r} and no campaign", "name a new or an empty folder"
            )

    def _as_begun(self) -> dict[str, Any]:
        file = self.path / FACTS
        try:
            return dict(json.loads(file.read_text(encoding="utf-8")))
        except (OSError, ValueError, TypeError) as problem:
            raise CampaignError(
                file, f"cannot be read ({problem})", "begin again in another folder"
            ) from None

    def _copy(self) -> str:
        """Of the specification; empty where it was lost."""
        return self.spec.read_text(encoding="utf-8") if self.spec.is_file() else ""

    def check_spec(self) -> None:
        """Check that the copy of the specification is the one that was flown.

        Raises:
            CampaignError: it was changed.
        """
        if self._as_begun().get("specification") != _mark(self._copy()):
            raise CampaignError(
                self.spec,
                "is not what was flown here, but was changed since",
                "put it back, or give the one that was flown: twin campaign SPEC.toml "
                f"{self.path} --resume",
            )

    def _changed(self, spec: Spec, mark: str) -> list[str]:
        """Keys that a specification has otherwise than the one that was flown, but for what is only
        kept of it; comments and order do not count."""
        stored, here = self._copy(), spec.text
        if mark not in (_mark(stored), _mark(here)):
            return ["keys than the copy there, which was changed or lost since"]
        former, current = (tomllib.loads(text) for text in (stored, here))
        keys = [key for key in {**former, **current} if former.get(key) != current.get(key)]
        return [key for key in keys if key != "keep"]

    def _compare(self, spec: Spec, resume: bool) -> None:
        former, current = self._as_begun(), _facts(spec)
        if former.get("specification") != current["specification"]:
            keys = self._changed(spec, str(former.get("specification")))
            if keys:
                raise CampaignError(
                    self.path,
                    f"holds a campaign of another specification: other {', '.join(keys)}",
                    f"name another folder, or give {self.spec}",
                )
        for kind in ("files", "versions"):
            if former.get(kind) != current[kind]:
                name = _first_difference(former.get(kind, {}), current[kind])
                raise CampaignError(
                    self.path,
                    f"was begun with another {name}, so its runs would not be of one kind",
                    "begin again in another folder",
                )
        if not resume:
            missing = len(self.missing(spec))
            raise CampaignError(
                self.path,
                f"holds this campaign already, {spec.shards - missing} of {spec.shards} shards",
                "say --resume to go on with it",
            )
        if former != current or self._copy() != spec.text:
            write_whole(self.spec, spec.text)
            write_whole(self.path / FACTS, json.dumps(current, indent=2) + "\n")


def _facts(spec: Spec) -> dict[str, Any]:
    return {
        "specification": _mark(spec.text),
        "runs": spec.runs,
        "shards": spec.shards,
        "files": {name: hash_of(file) for name, file in _files(spec).items()},
        "versions": versions(),
    }


def _files(spec: Spec) -> dict[str, Path]:
    """What results depend on beside packages, by what the specification calls it.

    Not by the file's own name, which two arms may share, nor by where it lies: the folder may move
    to another computer together with them.
    """
    files: dict[str, Path] = {}
    for arm in spec.arms:
        for name, file in files_of(arm.platform).items():
            files[f"platform {arm.machine}: {name}"] = file
        if spec.procedure == "run":
            files[f"controller {arm.controller}"] = find_controller(arm.controller)
        for effect in arm.effects:
            if (brought := file_of(effect.kind)) is not None:
                files[f"effect {effect.called}"] = brought
    return files


def versions() -> dict[str, str]:
    """Of the packages that decide about bits."""
    return {name: version(name) for name in _PACKAGES}


def _first_difference(former: Mapping[str, str], current: Mapping[str, str]) -> str:
    names = sorted({*former, *current})
    return next(name for name in names if former.get(name) != current.get(name))


def _mark(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def hash_of(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def arithmetic() -> str:
    """Mark of how this machine rounds.

    NumPy computes sines, exponentials and products with what a processor has, and their last bits
    differ between kinds of processors. Two machines with the same mark fly a campaign to the same
    bytes, given the same packages; two with different marks may not.
    """
    mark = hashlib.sha256()
    for function in _FUNCTIONS:
        mark.update(function(_ARGUMENTS).tobytes())
    square = _ARGUMENTS[:900].reshape(30, 30)
    mark.update(
        (square @ square).tobytes() + np.linalg.solve(square + np.eye(30), square).tobytes()
    )
    return mark.hexdigest()[:12]
