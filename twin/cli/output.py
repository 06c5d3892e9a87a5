"""What `--json` prints: one document of plain JSON."""

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, cast

import numpy as np


def print_json(document: object) -> None:
    """Print `document` on stdout; arrays become lists, and what is no finite number null."""
    print(json.dumps(_plain(document), indent=2, allow_nan=False, ensure_ascii=False))


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray | np.generic):
        return _plain(value.tolist())
    if isinstance(value, Mapping):
        items = cast(Mapping[Any, Any], value).items()
        return {str(key): _plain(entry) for key, entry in items}
    if isinstance(value, str):
        return value
    if isinstance(value, Sequence):
        return [_plain(entry) for entry in cast(Sequence[Any], value)]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Path):
        return str(value)
    return value
