"""Paper 004: what is computed for its tables and figures, as far as it is quick."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from papers.efficiency import cramer_rao, entries_of, is_rigid_body, tensor, trial_of
from papers.paper_004 import (
    PARTS,
    TABLE1_OURS_MOTION,
    UncertainTorque,
    as_guessed,
    fig10_compute,
    fig11_compute,
    flown,
    machine,
    resimulated,
    table1_wheels_compute,
    table2_unphysical_compute,
)
from twin.effects import State
from twin.identification import identify
from twin.plant.initial import hanging
from twin.rotation import rotate

ROWS = Path(__file__).parents[2] / "docs" / "reproduction.toml"


def test_every_row_of_the_paper_is_computed_once():
    rows = tomllib.loads(ROWS.read_text(encoding="utf-8"))["row"]
    wanted = [row["id"] for row in rows if row["id"].startswith("004.")]
    assert sorted(name for part in PARTS for name in part.ids) == sorted(wanted)


def test_held_level_the_offset_of_table_1_fills_a_wheel():
    (ours,) = table1_wheels_compute(print).rows.values()
    # 95 kg, 0.1 mm: 0.093 N m about each horizontal axis, for 300 s, in units of 5 N m s
    assert ours.value == pytest.approx(0.0931950 * 300.0 / 5.0, rel=1e-3)


def test_four_of_the_five_recursive_inertias_are_no_bodies():
    (ours,) = table2_unphysical_compute(print).rows.values()
    assert ours.value == 1.0


def test_a_plate_is_the_limit_of_what_a_body_can_be():
    assert is_rigid_body(tensor(np.array([1.0, 2.0, 2.999, 0.0, 0.0, 0.0])))
    assert not is_rigid_body(tensor(np.array([1.0, 2.0, 3.001, 0.0, 0.0, 0.0])))
    assert not is_rigid_body(tensor(np.array([1.0, 1.0, 1.0, 1.1, 0.0, 0.0])))


def test_hanging_means_that_the_offset_points_down():
    platform = machine("sads:table1")
    down = rotate(hanging(platform.center_of_mass_offset), platform.center_of_mass_offset)
    np.testing.assert_allclose(down / np.linalg.norm(down), [0.0, 0.0, -1.0], atol=1e-12)


def test_the_true_machine_simulated_again_moves_as_it_did():
    platform = machine("sads:table1_noise")
    (log,) = flown(platform, TABLE1_OURS_MOTION, duration=20.0, runs=1, seed=3)
    again, true = resimulated(platform, entries_of(platform), log), log["truth_rate"]
    apart = again.interpolated_at(true.time) - true.value
    assert np.abs(apart).max() < 1e-9


def test_the_uncertain_torque_is_drawn_anew_for_each_run_and_has_the_variance_it_claims():
    platform = machine("sads:table1")
    effect = UncertainTorque(0.01, seed=4)
    law = effect.torque(platform)
    drawn = []
    for piece in range(300):
        state = State(np.zeros((5, 4)), np.zeros((5, 3)), np.zeros((5, 3)), np.full(5, 0.2 * piece))
        drawn.append(law(state))
    values = np.array(drawn)
    assert np.abs(values).max() <= 0.01
    assert np.mean(values**2) * 0.2 == pytest.approx(effect.intensity, rel=0.05)
    assert np.abs(np.corrcoef(values[:, :, 0].T) - np.eye(5)).max() < 0.25


@pytest.mark.slow
def test_a_torque_that_coarse_sensors_hide_still_widens_the_intervals():
    platform = machine("sads:table1_noise")
    logs = flown(platform, TABLE1_OURS_MOTION, duration=100.0, runs=2, seed=5, torque=0.01)
    noise = {"gyro": 4.36e-3, "attitude": 0.0349, "wheel_speed": 0.1}
    for log in logs:
        found = identify([log.without_truth()], as_guessed(platform))
        bound = cramer_rao(platform, log, noise, UncertainTorque(0.01).intensity)
        trial = trial_of(found, platform, bound)
        assert found.misfit[0].is_noise, "the case is that chi-square does not show it"
        assert found.disturbance > 1e-3
        assert np.all(trial.half > 0.6 * 1.96 * bound)
        assert np.all(np.abs(trial.error) < 4.0 * bound)


@pytest.mark.slow
def test_what_was_found_moves_as_measured_and_masses_moved_by_it_balance():
    assert fig10_compute(print).rows["004.fig10.rates"].value < 0.1
    assert fig11_compute(print).rows["004.fig11.torque"].value < 0.01
