"""Every module and name of version 0.1 has the place in the package that docs/renamed.md gives."""

import re
from importlib import import_module
from pathlib import Path

import pytest

PAGE = (Path(__file__).parents[1] / "docs" / "renamed.md").read_text(encoding="utf-8")
MODULES, NAMES = (
    [
        place
        for row in re.findall(r"^\| `.*?` \| (`.*`) \|$", part, re.MULTILINE)
        for place in re.findall("`(.*?)`", row)
    ]
    for part in PAGE.split("\n## Classes and functions\n")
)


@pytest.mark.parametrize("module", sorted(set(MODULES)))
def test_every_module_of_the_table_can_be_imported(module: str):
    import_module(module)


@pytest.mark.parametrize("name", NAMES)
def test_every_class_of_the_table_is_in_its_module(name: str):
    module, _, attribute = name.rpartition(".")
    assert hasattr(import_module(module), attribute)
