"""Settings in TOML: whatever stands there is taken or refused in a sentence with its line."""

from pathlib import Path

import pytest

from twin.config import read_toml
from twin.errors import FileError


@pytest.fixture
def settings(tmp_path: Path) -> Path:
    return tmp_path / "settings.toml"


@pytest.mark.parametrize("text", ["mass = " + "9" * 5000, "mass = " + "[" * 5000], ids=["", "["])
def test_what_the_parser_itself_stumbles_over_is_refused(settings, text):
    settings.write_text(text)
    with pytest.raises(FileError, match=r"settings\.toml: holds a number of thousands of digits"):
        read_toml(settings)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("1" + "0" * 400, "mass is inf kg; give a finite number in kg"),
        ("-1" + "0" * 400, "mass is -inf kg"),
        ("nan", "mass is nan; give a number in kg"),
        ("true", "mass is True; give a number in kg"),
    ],
)
def test_a_number_that_no_float_holds_is_refused_with_its_line(settings, given, told):
    settings.write_text(f"\nmass = {given}\n")
    with pytest.raises(FileError) as refused:
        read_toml(settings).number("mass", unit="kg")
    assert str(refused.value).startswith(f"{settings}:2: {told}")
    with pytest.raises(FileError, match="mass"):
        read_toml(settings).numbers("mass", 3)


@pytest.mark.parametrize(("given", "read"), [("2e3", 2000), ("9007199254740993", 2**53 + 1)])
def test_a_whole_number_is_read_to_its_last_digit(settings, given, read):
    settings.write_text(f"count = {given}\n")
    assert read_toml(settings).whole("count") == read
