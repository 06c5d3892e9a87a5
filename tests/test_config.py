"""Settings in TOML: whatever stands there is taken or refused in a sentence with its line."""

import os
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


@pytest.mark.parametrize(
    "key", ["a" + ".a" * 20_000, '"a"' + ' . "a"' * 300, "['a'" + ".'a'" * 300]
)
def test_a_key_of_thousands_of_parts_is_refused_at_once(tmp_path, key):
    path = tmp_path / "long.toml"
    path.write_text(f"title = 1\n{key}{']' if key[0] == '[' else ' = 1'}\n")
    with pytest.raises(FileError, match=r"long.toml:2: has a key of more than 64 parts"):
        read_toml(path)


def test_prose_with_dots_is_no_key(tmp_path):
    path = tmp_path / "notes.toml"
    path.write_text(f'note = "{"A word. " * 500}{"." * 500}"\nkeys = [{"1.5, " * 500}]\n')
    assert read_toml(path).text("note").startswith("A word.")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes by name there")
def test_a_pipe_in_place_of_a_file_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(FileError, match="is no regular file; name a TOML file"):
        read_toml(tmp_path / "pipe.toml")
