"""A Python file that somebody brings: a control law, an effect.

It becomes a module of a private name that tells its path, so that other processes, to which
objects of its classes are sent, import the same file.
"""

import importlib
import os
import sys
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec
from importlib.util import spec_from_file_location
from pathlib import Path
from types import ModuleType

__path__: list[str] = []
"""Modules stand below this one; whoever asks for one of them imports this first."""
_ran: dict[str, bytes] = {}
"""What stood in the file of each module when it was run."""


class _ByPath(MetaPathFinder):
    """Finds the file of which a module's name tells."""

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        file = file_of(fullname)
        return None if file is None else spec_from_file_location(fullname, file)


sys.meta_path.append(_ByPath())


def file_of(module: str) -> Path | None:
    """The file that was run as the module of that name; None of a module of any other kind."""
    package, _, told = module.rpartition(".")
    return Path(os.fsdecode(bytes.fromhex(told))) if package == __name__ else None


def import_alone(path: Path) -> ModuleType:
    """Run a file that ends in .py as a module of a private name, so that it clashes with nobody's.

    It is run again only when it has changed: classes are hardly ever forgotten, and a campaign asks
    for its law with every shard. What the file raises passes through, and its module is forgotten
    then.
    """
    name = f"{__name__}.{os.fsencode(path.absolute()).hex()}"
    content = path.read_bytes()
    if name in sys.modules and _ran.get(name) == content:
        return sys.modules[name]
    sys.modules.pop(name, None)
    module = importlib.import_module(name)
    _ran[name] = content
    return module
