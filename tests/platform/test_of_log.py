"""The machine of a log is found where its log.toml says, seen from the log."""

import shutil
from pathlib import Path

import pytest

from twin.errors import UsageError
from twin.library import library
from twin.platform import in_gravity_of, load_platform, platform_of
from twin.recording import Recording, read_log


@pytest.fixture
def log_of(tmp_path: Path):
    """A log whose log.toml names a machine."""

    def write(platform: str) -> Path:
        folder = tmp_path / "logs" / "first"
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "gyro.csv").write_text("t,x,y,z\n0,1,2,3\n1,2,3,4\n")
        text = f'platform = "{platform}"\n[streams.gyro]\nfile = "gyro.csv"\n'
        (folder / "log.toml").write_text(text)
        return folder

    return write


@pytest.mark.parametrize(
    ("place", "name"),
    [
        ("logs/first/my_table", "my_table"),
        ("logs/first/my_table", "my_table:table1"),
        ("logs/my_table", "my_table"),
        ("logs/my_table", "my_table:table1"),
        ("my_table", "../../my_table:table1"),
    ],
)
def test_a_machine_beside_a_log_is_found(log_of, tmp_path: Path, place: str, name: str):
    folder = log_of(name)
    shutil.copytree(library("models") / "sads", tmp_path / place)
    platform = platform_of(read_log(folder))
    assert platform.folder == tmp_path / place
    assert platform.name == "sads" + ":table1" * name.endswith(":table1")


def test_a_shipped_machine_is_not_hidden_by_a_folder_beside_the_log(log_of, tmp_path: Path):
    folder = log_of("sads")
    shutil.copytree(library("models") / "sads", tmp_path / "logs" / "sads")
    assert platform_of(read_log(folder)).folder == library("models") / "sads"


def test_a_machine_that_is_nowhere_is_told_with_where_it_was_looked_for(log_of):
    folder = log_of("my_table")
    with pytest.raises(UsageError) as error:
        platform_of(read_log(folder))
    said = str(error.value)
    assert said.startswith("no platform named 'my_table' (")
    assert said.endswith(
        f"; looked in {folder}, beside it, in {Path.cwd()} and among the shipped ones: correct "
        "`platform` in log.toml, or name the machine with --platform"
    )


def test_logs_under_several_gravities_are_not_taken_together():
    logs = [
        Recording({}, {"source": name, "environment": {"gravity": value}})
        for name, value in (("one", 9.81), ("two", 9.78))
    ]
    platform = load_platform("sads")
    assert in_gravity_of([Recording({})], platform) is platform
    assert in_gravity_of(logs[1:], platform).gravity == 9.78
    with pytest.raises(UsageError, match=r"one has 9.81, two has 9.78 m/s\^2"):
        in_gravity_of(logs, platform)


def test_a_log_that_names_no_machine_is_told_what_would_do():
    with pytest.raises(UsageError, match="add `platform` to its log.toml, or name the machine"):
        platform_of(Recording({}))
