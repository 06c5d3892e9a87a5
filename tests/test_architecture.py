"""The house stands: a floor rests only on those below it, and no file needs itself."""

import ast
import re
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

TWIN = Path(__file__).parents[1] / "twin"

DESIGN = (TWIN.parent / "docs" / "design.md").read_text(encoding="utf-8")
HOUSE = DESIGN.split("\ntwin/\n")[1].split("\npapers/")[0]
FLOORS = [
    name.rstrip("/").removesuffix(".py")
    for names in re.findall(r"^  ([\w./]+(?:, [\w./]+)*) +(?!planned:)\S", HOUSE, re.MULTILINE)
    for name in names.split(", ")
]
"""Modules and folders of twin/, lowest first, as docs/design.md, section 3, lists them."""

FILES = sorted(TWIN.rglob("*.py"))
PAPERS = sorted((TWIN.parent / "papers").rglob("*.py"))
PUBLIC_DOORS = {"__init__", "__main__"}


def module_of(file: Path) -> str:
    parts = file.relative_to(TWIN.parent).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {module_of(file) for file in [*FILES, *PAPERS]}


def imported_by(file: Path) -> set[str]:
    """Modules of ours that a file imports, at its top or anywhere below."""
    found = set[str]()
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{file}: line {node.lineno} imports relative to itself"
            source = node.module or ""
            for alias in node.names:
                name = f"{source}.{alias.name}"
                found.add(name if name in MODULES else source)
    return {name for name in found if name.split(".")[0] in ("twin", "papers")}


def floor_of(module: str) -> str:
    return module.split(".")[1] if "." in module else ""


def test_every_module_has_its_floor():
    floors = {floor_of(module_of(file)) for file in FILES} - {"", "__main__"}
    assert floors == set(FLOORS), "tell docs/design.md, section 3, about it"


@pytest.mark.parametrize("file", FILES, ids=lambda file: str(file.relative_to(TWIN)))
def test_a_module_imports_only_from_the_floors_below(file: Path):
    floor = floor_of(module_of(file))
    if file.parent == TWIN and file.stem in PUBLIC_DOORS:
        return
    below = {"", *FLOORS[: FLOORS.index(floor) + 1]}
    ours = {name for name in imported_by(file) if name.split(".")[0] == "twin"}
    above = sorted(name for name in ours if floor_of(name) not in below)
    assert not above, f"{floor} stands below {', '.join(above)}"


def test_only_the_verb_reproduce_imports_what_no_wheel_has():
    importers = {
        module_of(file)
        for file in FILES
        if any(name.split(".")[0] == "papers" for name in imported_by(file))
    }
    assert importers == {"twin.cli.reproduce"}


def test_no_module_imports_itself_by_a_detour():
    graph = {module_of(file): imported_by(file) - {"twin"} for file in [*FILES, *PAPERS]}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


@pytest.mark.parametrize(
    "file", [file for file in FILES if file.name == "__init__.py"], ids=module_of
)
def test_an_init_file_only_re_exports(file: Path):
    if file.parent == TWIN:
        return
    docstring, *rest = ast.parse(file.read_text(encoding="utf-8")).body
    assert isinstance(docstring, ast.Expr)
    assert all(isinstance(node, ast.ImportFrom) for node in rest)
    names = [alias for node in rest for alias in getattr(node, "names", [])]
    assert all(alias.asname == alias.name for alias in names), "write `import X as X`"


@pytest.mark.parametrize(
    "file", [*FILES, *PAPERS], ids=lambda file: str(file.relative_to(TWIN.parent))
)
def test_a_module_says_what_it_is_for_and_stays_short(file: Path):
    text = file.read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)), "its first lines say what it is for"
    assert text.count("\n") <= 800, "split it: a module is one subject"


def test_no_two_classes_share_a_public_name():
    places: dict[str, list[str]] = {}
    for file in FILES:
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(module_of(file))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_the_steps_from_a_log_to_its_verdict_are_ten_and_each_imports_the_one_before():
    section = DESIGN.split("\n### From a log to its verdict\n")[1].split("\n## ")[0]
    steps = re.findall(r"^\d+\. `(.+?)`: ", section, re.MULTILINE)
    assert len(steps) == 10
    for before, after in zip(steps, steps[1:], strict=False):
        module = module_of(TWIN.parent / before)
        # itself, or the package that re-exports it
        doors = {module, module.rpartition(".")[0]}
        assert doors & imported_by(TWIN.parent / after), f"{after} imports nothing of {before}"
