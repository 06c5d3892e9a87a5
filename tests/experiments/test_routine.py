"""Free floats are held against each other rightly, and weights balance what masses leave."""

import json
from dataclasses import replace
from datetime import datetime, timedelta

import numpy as np
import pytest

from twin import TwinError, history, trim, verify
from twin.cli.main import main
from twin.diagnosis.experiment import SimulatedRun
from twin.experiments.routine import (
    AddedMass,
    FreeFloat,
    control_limit,
    free_float,
    periods,
    trend,
    with_mass,
)
from twin.interval import Interval
from twin.platform import Platform, load_platform

CUBESAT = load_platform("cubesat")


def floating(machine: Platform, seed: int) -> FreeFloat:
    run = SimulatedRun(machine, "free_float", 30.0, attitude=(4.0, 3.0, 0.0), rate=(0.0, 0.0, 1.0))
    log, obstacle = run.attempt(machine, seed=seed)
    assert obstacle == ""
    result = free_float(log.without_truth(), CUBESAT, source=f"seed {seed}")
    return replace(result, when=datetime(2026, 1, 1) + timedelta(days=seed))


@pytest.fixture(scope="module")
def floats() -> list[FreeFloat]:
    return [floating(CUBESAT, seed) for seed in range(3)]


@pytest.mark.slow
def test_intervals_of_free_floats_hold_the_truth(floats: list[FreeFloat]):
    names = ("mr_x", "mr_y", "mr_z", "vertical_offset")
    held = [item.numbers[name].holds(item.stated[name]) for item in floats for name in names]
    assert np.mean(held) >= 0.75


@pytest.mark.slow
def test_the_same_machine_is_in_control_and_a_screw_that_moved_is_not(floats: list[FreeFloat]):
    assert trend(CUBESAT, floats).departures == ()
    moved = with_mass(CUBESAT, AddedMass(1e-3, np.array([0.0, 0.0, 0.01])))
    changed = trend(CUBESAT, [*floats, floating(moved, 9)])
    assert "vertical_offset" in changed.departures


def test_limits_widen_by_what_recordings_scatter_beyond_their_intervals():
    sharp = [Interval(value, value - 0.01, value + 0.01) for value in (1.0, 1.4, 0.7, 1.2)]
    limit = control_limit(sharp, Interval(1.5, 1.49, 1.51))
    assert limit.spread == pytest.approx(np.std([1.0, 1.4, 0.7, 1.2], ddof=1), rel=1e-3)
    assert limit.inside
    assert not control_limit(sharp, Interval(3.0, 2.99, 3.01)).inside


def test_limits_of_readings_that_only_scatter_by_their_noise_miss_one_in_370():
    rng = np.random.default_rng(5)
    half, outside = 1.96, 0
    for _ in range(2000):
        values = rng.standard_normal(13)
        *earlier, last = (Interval(v, v - half, v + half) for v in values.tolist())
        outside += not control_limit(earlier, last).inside
    assert outside <= 12


def test_periods_are_those_of_a_pendulum():
    machine = replace(
        CUBESAT, inertia=np.diag([0.02, 0.02, 0.03]), center_of_mass_offset=np.array([0, 0, -1e-4])
    )
    expected = 2.0 * np.pi * np.sqrt(0.02 / (1e-4 * machine.gravity))
    assert periods(machine, machine.center_of_mass_offset) == pytest.approx([expected] * 2)
    assert periods(machine, np.array([0.0, 0.0, 1e-4])) == ()


def test_a_mass_that_is_added_and_taken_away_changes_nothing():
    added = AddedMass(1.2, np.array([0.1, -0.2, 0.3]))
    there = with_mass(CUBESAT, added)
    assert there.inertia[0, 0] - CUBESAT.inertia[0, 0] == pytest.approx(1.2 * (0.04 + 0.09))
    assert there.inertia[0, 1] - CUBESAT.inertia[0, 1] == pytest.approx(1.2 * 0.02)
    back = with_mass(there, AddedMass(-1.2, added.position))
    np.testing.assert_allclose(back.inertia, CUBESAT.inertia, atol=1e-15)
    np.testing.assert_allclose(back.center_of_mass_offset, CUBESAT.center_of_mass_offset)


def test_stages_within_reach_bring_the_moment_to_the_target():
    result = trim("sads", below=50e-6)
    axes = np.stack([stage.mass * stage.axis for stage in result.platform.stages], axis=1)
    np.testing.assert_allclose(result.moment + axes @ result.stages, result.target, atol=1e-9)
    assert result.weights == ()


def test_each_proposed_weight_takes_the_rest_away():
    result = trim("sads", add=[(1.2, 0.3, 0.0, 0.2)])
    assert len(result.weights) > 0
    for weight in result.weights:
        np.testing.assert_allclose(weight.mass * weight.position, -result.rest, atol=1e-12)
    for stage, position in zip(result.platform.stages, result.stages, strict=True):
        assert stage.travel[0] - 1e-9 <= position <= stage.travel[1] + 1e-9


def test_verify_without_a_recording_shows_what_a_float_could(capsys):
    assert main(["verify", "cubesat", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["simulated"]
    assert document["recordings"][0]["misfit"] == pytest.approx(1.0, abs=0.1)
    assert main(["trim", "sads", "--add", "1.2", "0.3", "0", "0.2"]) == 0
    assert "One of these weights takes it away" in capsys.readouterr().out


@pytest.mark.slow
def test_a_folder_has_a_history_and_says_what_it_skips(tmp_path, capsys):
    words = ["run", "cubesat", "--duration", "12", "--attitude", "4", "3", "0", "--rrd"]
    for seed in range(3):
        assert main([*words, str(tmp_path / f"{seed}.rrd"), "--seed", str(seed)]) == 0
    assert main(["run", "sads", "--duration", "2", "--rrd", str(tmp_path / "other.rrd")]) == 0
    page = tmp_path / "page.html"
    assert main(["history", str(tmp_path), "--platform", "cubesat", "--html", str(page)]) == 0
    assert "Control charts" in page.read_text(encoding="utf-8")
    printed = capsys.readouterr().out
    assert "the 2 earlier ones" in printed or "against 2 earlier ones" in printed
    assert "skipped other.rrd: it is of sads" in printed


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: verify("whorl1"), "hangs at .* beyond its stop"),
        (lambda: verify("dfki_pendulum"), "does not turn about a ball bearing"),
        (lambda: trim("sads", add=[(0.0, 1.0, 0.0, 0.0)]), "give one above 0"),
        (lambda: trim("sads", add=[(1.0, 1.0)]), "four numbers"),
        (lambda: history("nowhere"), "nowhere is no folder"),
    ],
)
def test_a_mistake_is_told_with_what_would_do(call, sentence):
    with pytest.raises(TwinError, match=sentence):
        call()
