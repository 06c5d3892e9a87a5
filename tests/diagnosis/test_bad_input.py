"""Logs that cannot carry a verdict get a sentence that helps, an exit code, and no verdict."""

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from twin.cli.main import main
from twin.diagnosis import diagnosis
from twin.errors import UsageError
from twin.predict.rollouts import BeyondBounds

Array = NDArray[np.float64]
Change = Callable[[str, Array], Array]

SEED = 4
SHARED = ("gyro", "attitude", "wheel_speed", "command_wheel_torque")


@pytest.fixture(scope="module")
def good(tmp_path_factory) -> Path:
    """A short run of sads as a folder of tables."""
    folder = tmp_path_factory.mktemp("good")
    fly = ["run", "sads", "--controller", "quaternion_pd", "--duration", "6", "--seed", str(SEED)]
    assert main([*fly, "--rrd", str(folder / "run.rrd")]) == 0
    assert main(["export", str(folder / "run.rrd"), str(folder / "log")]) == 0
    return folder / "log"


@pytest.fixture
def log(good, tmp_path) -> Path:
    """A copy that may be spoiled."""
    return Path(shutil.copytree(good, tmp_path / "log"))


@pytest.fixture
def said(capsys) -> Callable[..., tuple[int, str]]:
    """Exit code and what was said of a diagnosis that must not come to a verdict."""

    def diagnose(log: Path, *more: str) -> tuple[int, str]:
        capsys.readouterr()
        code = main(["diagnose", str(log), *more])
        out, err = capsys.readouterr()
        assert out == "", "no verdict that pretends"
        assert err.startswith("twin: ")
        return code, err

    return diagnose


def spoil(log: Path, change: Change, *streams: str) -> None:
    """Change the numbers (rows, 1 + columns) of some tables; of all without a name."""
    for path in [log / f"{name}.csv" for name in streams] or sorted(log.glob("*.csv")):
        head = path.read_text().partition("\n")[0]
        table = change(path.stem, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2))
        np.savetxt(path, table, delimiter=",", header=head, comments="", fmt="%.17g")


def only(log: Path, *kept: str) -> None:
    """Leave the other streams out of log.toml."""
    first, *blocks = (log / "log.toml").read_text().split("[streams.")
    kept_blocks = [block for block in blocks if block.partition("]")[0] in kept]
    (log / "log.toml").write_text("[streams.".join([first, *kept_blocks]))


def test_a_clock_that_runs_backwards_is_told_with_file_and_line(log, said):
    spoil(log, lambda _, table: table[::-1], "gyro")
    code, text = said(log)
    assert code == 1
    assert "gyro.csv:" in text
    assert "time goes back" in text


def test_what_is_no_number_is_told_with_file_and_line(log, said):
    def holed(_: str, table: Array) -> Array:
        table[100, 2] = np.nan
        return table

    spoil(log, holed, "gyro")
    code, text = said(log)
    assert code == 1
    assert "gyro.csv:102" in text
    assert "'nan'" in text


def test_a_file_without_rows_is_told(log, said):
    (log / "gyro.csv").write_text("time,x,y,z\n")
    code, text = said(log)
    assert code == 1
    assert "no rows" in text


def test_a_recording_of_something_else_is_told(tmp_path, said):
    (tmp_path / "notes.rrd").write_text("not a recording")
    code, text = said(tmp_path / "notes.rrd")
    assert code == 1
    assert "no Rerun recording" in text


def test_a_log_of_a_few_samples_is_too_short(log, said):
    spoil(log, lambda _, table: table[table[:, 0] < 0.15])
    code, text = said(log)
    assert code == 2
    assert "at least 10 samples" in text


def test_a_log_with_fewer_numbers_than_unknowns_is_too_short(log, said):
    only(log, "attitude", "command_wheel_torque")
    spoil(log, lambda _, table: table[:10], "attitude")
    code, text = said(log)
    assert code == 2
    assert "too short" in text


def test_a_second_of_motion_is_no_ground_for_naming_causes(log, said):
    spoil(log, lambda _, table: table[table[:, 0] < 1.0])
    code, text = said(log)
    assert code == 2
    assert "too short" in text
    assert "record 1200 or more: 2 s at these rates" in text


def test_a_sensor_that_was_off_is_no_machine_at_rest(log, said):
    spoil(log, lambda _, table: np.column_stack([table[:, 0], 0.0 * table[:, 1:]]), "gyro")
    code, text = said(log)
    assert code == 2
    assert "gyro is the same in all" in text


def test_a_machine_at_rest_is_not_called_healthy(log, said):
    rng = np.random.default_rng(SEED)

    def rest(name: str, table: Array) -> Array:
        noise = {"gyro": 1e-3, "attitude": 5e-4, "wheel_speed": 0.1}.get(name, 0.0)
        still = np.tile([1.0, 0.0, 0.0, 0.0], (len(table), 1)) if name == "attitude" else 0.0
        return np.column_stack([table[:, 0], still + noise * rng.normal(size=table[:, 1:].shape)])

    print(f"seed {SEED}")
    only(log, *SHARED)
    spoil(log, rest, *SHARED)
    code, text = said(log)
    assert code == 2
    assert "hardly moves" in text
    assert "no verdict on the model" in text


def test_a_gyro_beyond_its_stated_range_leaves_nothing_to_go_by(log, said):
    spoil(log, lambda _, table: np.column_stack([table[:, 0], 100.0 + table[:, 1:]]), "gyro")
    code, text = said(log)
    assert code == 2
    assert "nothing is left of gyro" in text


@pytest.mark.parametrize(
    ("stream", "unit"), [("command_wheel_torque", "mN m"), ("stage_position", "mm")]
)
def test_a_part_that_does_a_thousand_times_what_it_can_is_in_another_unit(log, said, stream, unit):
    def wrong(_: str, table: Array) -> Array:
        return np.column_stack([table[:, 0], 1000.0 * (table[:, 1:] + 0.01)])

    spoil(log, wrong, stream)
    code, text = said(log)
    assert code == 2
    assert f"looks like {unit}" in text


def test_streams_on_two_clocks_are_told(log, said):
    spoil(log, lambda _, table: table + 1000.0 * (np.arange(table.shape[1]) == 0), "gyro")
    code, text = said(log)
    assert code == 2
    assert "share no time" in text


@pytest.mark.parametrize("command", ["show", "identify", "compare"])
@pytest.mark.parametrize(
    ("stream", "factor", "moved", "problem"),
    [
        ("gyro", 1.0, 1000.0, "share no time"),
        ("gyro", 0.0, 0.0, "gyro is the same in all"),
        ("command_wheel_torque", 1e3, 0.0, "looks like mN m"),
    ],
)
def test_what_no_verdict_is_built_on_no_other_command_takes_either(
    log, capsys, command, stream, factor, moved, problem
):
    def wrong(_: str, table: Array) -> Array:
        return np.column_stack([table[:, 0] + moved, factor * (table[:, 1:] + 0.01)])

    spoil(log, wrong, stream)
    capsys.readouterr()
    code = main([command, str(log)])
    out, err = capsys.readouterr()
    assert problem in (out if command == "show" else err)
    assert code == (1 if command == "show" else 2)


def test_a_log_that_leans_beyond_the_stop_is_not_of_that_machine(log, said):
    def leaning(_: str, table: Array) -> Array:
        half = 0.5 * np.radians(80.0) * np.sin(table[:, 0])
        zero = np.zeros_like(half)
        return np.column_stack([table[:, 0], np.cos(half), np.sin(half), zero, zero])

    def turning(_: str, table: Array) -> Array:
        rate = np.radians(80.0) * np.cos(table[:, 0])
        return np.column_stack([table[:, 0], rate, 0.0 * rate, 0.0 * rate])

    spoil(log, leaning, "attitude")
    spoil(log, turning, "gyro")
    code, text = said(log)
    assert code == 2
    assert "[tilt_stop]" in text


@pytest.mark.parametrize(
    ("platform", "problem"),
    [
        ("dfki_pendulum", "no wheels"),
        ("astros", "4 such parts"),
        ("tas2", "no wheels"),
        ("nowhere", "no platform named"),
    ],
)
def test_a_machine_that_does_not_fit_the_log_is_told(log, said, platform, problem):
    code, text = said(log, "--platform", platform)
    assert code == 2
    assert problem in text


def test_logs_of_two_machines_are_not_taken_together(log, tmp_path, said):
    other = Path(shutil.copytree(log, tmp_path / "other"))
    text = (other / "log.toml").read_text()
    (other / "log.toml").write_text(text.replace('platform = "sads"', 'platform = "whorl1"'))
    for more in ([str(other)], ["--validate", str(other)]):
        code, sentence = said(log, *more)
        assert code == 2
        assert "sads" in sentence
        assert "whorl1" in sentence


def test_a_log_validates_no_fit_that_it_takes_part_in(log, said):
    code, text = said(log, "--validate", str(log))
    assert code == 2
    assert "takes part" in text


def test_a_log_that_cannot_validate_is_told_last(log, tmp_path, capsys, monkeypatch):
    def refuse(*_: object) -> None:
        raise UsageError("it leans too far")

    monkeypatch.setattr("twin.diagnosis.validate", refuse)
    other = shutil.copytree(log, tmp_path / "other")
    assert main(["diagnose", str(log), "--validate", str(other)]) == 2
    told = capsys.readouterr()
    assert "Healthy" in told.out
    assert "it leans too far" in told.err


def test_what_shows_the_motion_is_named_where_it_is_missing(log, said):
    only(log, "gyro", "wheel_speed")
    code, text = said(log)
    assert code == 2
    assert "'attitude'" in text


def test_a_prediction_that_runs_away_asks_for_signs_and_units(log, said, monkeypatch):
    def away(*_: object, **__: object) -> None:
        raise BeyondBounds("a machine with such parameters moves beyond all bounds")

    monkeypatch.setattr(diagnosis, "baseline_of", away)
    code, told = said(log)
    assert code == 2
    assert "beyond all bounds, whatever its base is: look at the signs and units" in told
    assert log.name in told


def test_a_place_that_cannot_be_written_is_told_before_the_work(log, tmp_path, said):
    (tmp_path / "file").write_text("precious")
    for more in (
        ["--extend", str(tmp_path / "file")],
        ["--extend", str(tmp_path / "file" / "in")],
        ["--report", str(tmp_path)],
        ["--report", str(tmp_path / "file" / "page.html")],
    ):
        code, text = said(log, *more)
        assert code == 2
        assert str(tmp_path) in text
    assert (tmp_path / "file").read_text() == "precious"
