"""docs/platforms.md has every key of platform.toml as the loader takes it; its example checks."""

import ast
import inspect
import re
from dataclasses import fields
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest

from twin.cli.main import main
from twin.config import Table
from twin.effects import effects_of
from twin.library import model_names
from twin.model import compile_model
from twin.plant import hardware_setup
from twin.plant.guard.rules import GuardSettings
from twin.platform import load, load_platform
from twin.recording import environment
from twin.scaffold import KINDS, new_platform

PAGE = (Path(__file__).parents[2] / "docs" / "platforms.md").read_text(encoding="utf-8")
MACHINE = PAGE[PAGE.index("## The machine") : PAGE.index("## Hardware")]
HARDWARE = PAGE[PAGE.index("## Hardware") :]
EXAMPLE = PAGE[PAGE.index("## A worked example") : PAGE.index("## What goes for all keys")]
ROW = re.compile(r"^\| `(\w+)` \| ([^|]+) \| ([^|]+) \| .*\|$", re.MULTILINE)
TYPES = ("number", "numbers", "text", "texts")
"""Ways in which a `Table` is asked for a value."""


class Key(NamedTuple):
    """A key of a table, told by the page or asked for by the loader."""

    table: str
    name: str
    unit: str
    default: str


def told() -> set[Key]:
    """What the page says."""
    keys: set[Key] = set()
    for section in re.split(r"^##+ ", MACHINE, flags=re.MULTILINE)[1:]:
        heading = section.partition("\n")[0]
        if heading == "The machine" or heading.startswith("["):
            table = heading.strip("[]").removesuffix(".STREAM") if heading[0] == "[" else ""
            keys |= {Key(table, *row) for row in ROW.findall(section)}
    return keys


@pytest.fixture(scope="module")
def asked(tmp_path_factory: pytest.TempPathFactory) -> set[Key]:
    """What the loader asks for while it reads every machine that is shipped or begun with."""
    keys: set[Key] = set()

    def listen(kind: str) -> Any:
        ask = getattr(Table, kind)

        def heard(table: Table, key: str, *rest: Any, **more: Any) -> Any:
            name = table.name.removeprefix("variants.drives.")
            if name == "gimbals.drive" or not table.name.startswith("variants."):
                keys.add(key_of(name, key, kind, rest, more))
            return ask(table, key, *rest, **more)

        return heard

    def key_of(name: str, key: str, kind: str, rest: tuple[Any, ...], more: dict[str, Any]) -> Key:
        # `size` stands before the default of a list of numbers
        given = rest[1:] if kind == "numbers" else rest
        unit = kind if kind in ("text", "texts") else more.get("unit") or "1"
        default = in_words(given[0]) if given else "required"
        if name.startswith("sensors."):
            name = "sensors"
            if key in ("noise", "bias", "resolution", "range"):
                unit = "the stream's"
        return Key(name, key, unit, default)

    folder = tmp_path_factory.mktemp("begun")
    with pytest.MonkeyPatch.context() as patch:
        for kind in TYPES:
            patch.setattr(Table, kind, listen(kind))
        for name in (*model_names(), "tas2:drives"):
            load_platform(name)
        for kind in KINDS:
            load_platform(new_platform(folder / kind, kind))
    return keys


def in_words(default: Any) -> str:
    """A default as the page has it."""
    if isinstance(default, np.ndarray):
        return "identity" if np.any(default) else "0"
    if isinstance(default, str):
        return f'`"{default}"`'
    return f"{default:g}" if isinstance(default, float | int) else "none"


def literals(module: ModuleType, ways: tuple[str, ...], within: str = "") -> set[str]:
    """Keys that the source of a module, or of one function of it, asks a table for by name."""
    tree: ast.AST = ast.parse(inspect.getsource(getattr(module, within) if within else module))
    return {
        call.args[0].value
        for call in ast.walk(tree)
        if isinstance(call, ast.Call)
        and isinstance(call.func, ast.Attribute)
        and call.func.attr in ways
        and call.args
        and isinstance(call.args[0], ast.Constant)
        and isinstance(call.args[0].value, str)
    }


def test_every_key_that_the_loader_takes_is_on_the_page_with_its_unit_and_default(
    asked: set[Key],
):
    assert asked - told() == set(), "asked for, not told"
    assert told() - asked == set(), "told, never asked for"


def test_no_key_of_the_loader_went_unheard(asked: set[Key]):
    sources = (load, environment)
    by_name = set[str]().union(*(literals(module, TYPES) for module in sources))
    assert len(by_name) > 40
    assert by_name - {key.name for key in asked} == set(), "a machine of tests or models needs it"


def test_every_table_that_the_loader_takes_is_on_the_page():
    tables = literals(load, ("table", "raw"))
    for name in tables:
        assert re.search(rf"^#+ .*\[(\w+\.)?{name}\]|`\[{name}[\].]", PAGE, re.MULTILINE), name
    for name in literals(load, ("tables",)):
        assert re.search(rf"^### \[\[(\w+\.)?{name}\]\]", PAGE, re.MULTILINE), name


def test_every_stream_that_a_simulation_measures_is_on_the_page():
    rows = re.findall(r"^\| (`.*?) \|", MACHINE, re.MULTILINE)
    names = {name for row in rows for name in re.findall("`(.*?)`", row)}
    assert set(load.MEASURED) - names == set()


def test_every_key_of_hardware_and_of_its_guard_is_on_the_page():
    ways = (*TYPES, "table")
    known = literals(hardware_setup, ways, "read_hardware") - {"hardware"}
    known |= literals(hardware_setup, ways, "_route") | literals(hardware_setup, ways, "_scale")
    known |= {field.name for field in fields(GuardSettings)}
    assert {row[0] for row in ROW.findall(HARDWARE)} == known


def test_the_worked_example_goes_as_the_page_tells_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
):
    monkeypatch.chdir(tmp_path)
    assert main(["new", "my_table"]) == 0
    steps = re.findall(r"```diff\n(.*?)```", EXAMPLE, re.DOTALL)
    wrong = [change_and_check(step, capsys) for step in steps]
    assert wrong == [2, 0, 1, 0]
    main(["check", "my_table"])
    (count,) = re.findall(r"(\d+) checks, all ok", capsys.readouterr().out)
    assert EXAMPLE.count(f"All {count} checks are ok") == 2


def change_and_check(step: str, capsys: pytest.CaptureFixture[str]) -> int:
    """Make the change that a block of the page shows; how many checks are wrong then."""
    for place in step.split("\n\n"):
        lines = place.splitlines()
        old, new = ("\n".join(line[1:] for line in lines if line[0] == sign) for sign in "-+")
        texts = {file: file.read_text() for file in Path("my_table").glob("platform.*")}
        (found,) = (file for file, text in texts.items() if text.count(old) == 1)
        found.write_text(texts[found].replace(old, new))
    capsys.readouterr()
    main(["check", "my_table"])
    lines = capsys.readouterr().out.splitlines()
    wrong = [number for number, line in enumerate(lines) if line.startswith("  WRONG")]
    for number in wrong:
        assert "\n".join(lines[number : number + 2]) in EXAMPLE, "the page tells it otherwise"
    return len(wrong)


def test_the_effects_and_the_variant_that_the_page_shows_are_taken(tmp_path: Path):
    folder = new_platform(tmp_path / "my-own", "table")
    shown = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    with (folder / "platform.toml").open("a") as file:
        file.write("\n".join(shown))
    platform = load_platform(f"{folder}:heavy")
    compile_model(platform)
    assert [effect.label for effect in effects_of(platform)] == [
        "bearing_viscous_friction",
        "clock_lag:wheel_speed",
        "gyro_bias",
    ]
    assert [stage.mass for stage in platform.stages] == [1.1] * 3
    assert platform.mass == 43.0
