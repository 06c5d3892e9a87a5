"""A wrong convention is called by its name, and a right log is left in peace."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom

from tests.seeds import seed_of
from twin.cli.main import main
from twin.conventions import check_conventions, convention_advice
from twin.conventions.time_base import check_times
from twin.errors import UsageError
from twin.platform import Platform, load_platform
from twin.recording import open_log
from twin.units import unit_named


def _beside(name: str):
    """A module of this folder; tests are no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


flights = _beside("flights")
panel = _beside("panel")

BY_CHANCE = 1e-3
"""How often a part of the panel may fall short though the whole keeps its promise."""


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture(scope="module")
def right_logs(sads, request: pytest.FixtureRequest):
    """One log of each grade, each in another motion; the first is what mistakes are made of."""
    seed = seed_of(request)
    draw = np.random.default_rng(seed)
    one, other = draw.permutation(["slow", "unstable"]).tolist()
    pairs = [("middle", "multisine"), ("fine", one), ("coarse", other)]
    return draw, [
        log for grade, motion in pairs for log in flights.flights(sads, draw, grade, motion, 1)
    ]


def test_a_right_log_has_no_finding(sads, right_logs):
    _, logs = right_logs
    assert [str(finding) for log in logs for finding in check_conventions(log, sads)] == []


@pytest.mark.parametrize("cause", ["bearing_viscous_friction", "harness_stiffness"])
def test_a_strong_torque_that_the_model_lacks_is_not_taken_for_turned_wheels(
    sads, tmp_path, cause, request: pytest.FixtureRequest
):
    """Where a body slews about one axis, wheels read as those of another seem to do nothing, and
    that leaves less than wheels whose momentum friction has taken."""
    seed = seed_of(request)
    size = float(np.random.default_rng(seed).uniform(0.02, 0.4))
    log = tmp_path / "log.rrd"
    words = ["--reference", "slew:5,-5,90@6", "--seed", str(seed), "--effects", f"{cause}={size}"]
    assert main(["run", "sads", "--controller", "quaternion_pd", *words, "--rrd", str(log)]) == 0
    assert [str(finding) for finding in check_conventions(open_log(log), sads)] == []


@pytest.mark.parametrize("kind", ["unit", "order", "direction", "flipped", "swapped", "time_unit"])
def test_a_wrong_convention_is_named(sads, right_logs, kind):
    draw, logs = right_logs
    mistake = flights.make_mistake(logs[0], draw, kind)
    sentences = [finding.sentence for finding in check_conventions(mistake.recording, sads)]
    assert any(mistake.name in sentence for sentence in sentences), (mistake.stream, sentences)


@pytest.mark.parametrize(("stream", "unit"), [("wheel_speed", "rpm"), ("gyro", "deg/s")])
def test_a_wrong_unit_is_named_in_a_short_log_too(sads, right_logs, stream, unit):
    _, logs = right_logs
    right = logs[0].between(0.0, 20.0)
    wrong = flights.misread(right, stream, value=right[stream].value / unit_named(unit).factor)
    sentences = [finding.sentence for finding in check_conventions(wrong, sads)]
    assert len(sentences) == 1
    assert f"{stream} looks like {unit}".lower() in sentences[0].lower()


@pytest.mark.parametrize(
    ("machine", "stream", "unit"),
    [("cubesat", "magnetometer", "uT"), ("astros", "inclinometer", "deg")],
)
def test_the_unit_of_a_field_or_a_slope_is_told_by_its_size(tmp_path, machine, stream, unit):
    log = tmp_path / "log.rrd"
    words = ["run", machine, "--controller", "free_float", "--duration", "12"]
    assert main([*words, "--attitude", "4", "-6", "10", "--rrd", str(log)]) == 0
    platform, right = load_platform(machine), open_log(log)
    assert [str(finding) for finding in check_conventions(right, platform)] == []
    wrong = flights.misread(right, stream, value=right[stream].value / unit_named(unit).factor)
    sentences = [finding.sentence for finding in check_conventions(wrong, platform)]
    assert len(sentences) == 1
    assert f"{stream} looks like {unit}".lower() in sentences[0].lower()


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us")])
def test_times_that_are_all_of_them_in_another_unit_are_named(sads, right_logs, factor, unit):
    _, logs = right_logs
    wrong = logs[0]
    for name, series in logs[0].items():
        wrong = flights.misread(wrong, name, time=series.time * factor)
    sentences = [finding.sentence for finding in check_conventions(wrong, sads)]
    assert any(f"look like {unit}, read as s" in sentence for sentence in sentences), sentences
    assert not any("gyro looks like" in sentence for sentence in sentences), sentences
    with pytest.raises(UsageError, match=f"look like {unit}, read as s; write time_unit"):
        check_times(wrong, sads)


@pytest.mark.parametrize("tick", [1e-4, 1e-7, 86400.0, 3e-3])
def test_times_in_counts_are_named_with_the_seconds_of_one(sads, right_logs, tick):
    _, logs = right_logs
    wrong = logs[0]
    for name, series in logs[0].items():
        wrong = flights.misread(wrong, name, time=(123.0 + series.time) / tick)
    advice = convention_advice(wrong, sads)
    found = [line for line in advice.log_toml.splitlines() if line.startswith("time_scale = ")]
    assert len(found) == len(logs[0])
    assert float(found[0].rpartition(" ")[2]) == pytest.approx(tick, rel=0.05)
    with pytest.raises(UsageError, match="look like counts of .* write time_scale = "):
        check_times(wrong, sads)


@pytest.mark.slow
def test_most_of_a_panel_is_recognised_and_no_right_log_is_accused(
    sads, request: pytest.FixtureRequest
):
    seed = seed_of(request)
    order = np.random.default_rng(seed).permutation(len(panel.CELLS))[:4]
    rows = [row for cell in order for row in panel.fly_and_check(sads, int(cell), seed + int(cell))]
    print(panel.table(rows))
    assert not [row for row in rows if row["verdict"] == "accused"]
    seen = [row["verdict"] in ("named", "tied") for row in rows if panel.misread_visibly(row)]
    fewest = binom.ppf(BY_CHANCE, len(seen), panel.PROMISED)
    assert sum(seen) >= fewest, f"{sum(seen)} of {len(seen)} recognised"
