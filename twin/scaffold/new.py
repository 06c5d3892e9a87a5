"""Copy a template under a new name. The templates beside this file are platforms themselves."""

import re
import shutil
from pathlib import Path

from twin.errors import UnknownName, UsageError
from twin.library import model_names

KINDS = {
    "table": "a table on a ball bearing: three wheels, three sliding masses, gyro, attitude sensor",
    "pendulum": "a body on a hinge, with an encoder",
    "free": "a body that is thrown, with a wheel, a gyro and motion capture",
}
"""Template folders, and what they hold."""

_HERE = Path(__file__).parent
_TEMPLATE_NAME = "my-machine"
"""What the templates are called in their own files."""


def new_platform(path: Path, kind: str) -> Path:
    """Write a platform folder of that kind; its last part is the machine's name.

    Raises:
        UnknownName: no such kind.
        UsageError: the folder exists, or its name is no name for a machine.
    """
    if kind not in KINDS:
        raise UnknownName("kind of machine", kind, KINDS)
    name = path.name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        raise UsageError(
            f"a machine cannot be called {name!r}: begin with a letter, go on with letters, "
            "digits, - and _"
        )
    if name in model_names():
        raise UsageError(f"{name!r} is a machine that is shipped; choose another name")
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise UsageError(f"{path} is there already; choose another name, or move it away") from None
    except OSError as problem:
        raise UsageError(f"cannot write {path}: {problem.strerror}") from None
    try:
        for file in sorted((_HERE / kind).iterdir()):
            text = file.read_text(encoding="utf-8").replace(_TEMPLATE_NAME, name)
            (path / file.name).write_text(text, encoding="utf-8")
    except OSError as problem:
        shutil.rmtree(path, ignore_errors=True)
        raise UsageError(f"cannot write {path}: {problem.strerror}") from None
    return path
