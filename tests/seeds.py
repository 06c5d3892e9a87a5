"""Seeds of drawn tests: another one for each test and each state of the code, and reproducible.

A seed derives from the test's name and from the code under test, or from `--seed N`. A change of
the code draws all cases anew. The same code draws the same cases on any machine: what fails in one
place fails in all.
"""

import hashlib
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
CODE = ("twin", "controllers", "models")


@cache
def of_code() -> int:
    """Digest of the code under test and of the machines' descriptions."""
    digest = hashlib.blake2b(digest_size=8)
    for folder in CODE:
        for suffix in ("*.py", "*.toml", "*.xml"):
            for path in sorted((ROOT / folder).rglob(suffix)):
                digest.update(path.relative_to(ROOT).as_posix().encode())
                digest.update(path.read_bytes())
    return int.from_bytes(digest.digest(), "big")


def seed_of(request: pytest.FixtureRequest) -> int:
    """The seed of a test, or of the module whose fixture asks; printed."""
    stated = request.config.getoption("--seed")
    name = f"{of_code() if stated is None else stated} {request.node.nodeid}"
    seed = int.from_bytes(hashlib.blake2b(name.encode(), digest_size=4).digest(), "big") >> 1
    print("seed", seed)
    return seed
