"""A Python file that somebody brings: a control law, an effect."""

import hashlib
import importlib.util
import sys
from pathlib import Path
from types import ModuleType


def import_alone(path: Path) -> ModuleType:
    """Run a file that ends in .py as a module of a private name, so that it clashes with nobody's.

    What the file raises passes through, and its module is forgotten then.
    """
    name = f"_twin_{path.stem}_{hashlib.sha256(str(path).encode()).hexdigest()[:12]}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[name]
        raise
    return module
