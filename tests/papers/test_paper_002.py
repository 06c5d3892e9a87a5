"""Paper 002: what is computed for its tables and figures, as far as it is quick."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from papers import paper_002
from papers.efficiency import cramer_rao, trial_of
from papers.paper_002 import (
    PARTS,
    SCATTER,
    TABLE2_PART,
    as_handed_in,
    table2_compute,
    table4_compute,
)
from papers.paper_002_figures import (
    GYRO,
    METHODS,
    as_guessed,
    fig4_compute,
    fig9_compute,
    ideal,
    machine,
    measured,
    natural_frequency,
    samples,
    shifted,
    tracked,
)
from twin import rotation
from twin.identification import identify
from twin.predict.logs import attitude_of_start, motion_of

ROWS = Path(__file__).parents[2] / "docs" / "reproduction.toml"


def test_every_row_of_the_paper_is_computed_once():
    rows = tomllib.loads(ROWS.read_text(encoding="utf-8"))["row"]
    wanted = [row["id"] for row in rows if row["id"].startswith("002.")]
    assert sorted(name for part in PARTS for name in part.ids) == sorted(wanted)


@pytest.fixture(scope="module")
def perfect() -> dict[str, float]:
    return {name: float(ours.value) for name, ours in table2_compute(print).rows.items()}


def test_on_perfect_data_every_method_finds_all_nine_parameters(perfect):
    assert set(perfect) == set(TABLE2_PART.ids)
    assert max(perfect.values()) < 0.5


def test_the_data_reach_the_rate_that_the_paper_states():
    assert np.abs(ideal()["gyro"].value).max() == pytest.approx(0.1, rel=0.1)
    assert 0.0 < rotation.tilt(tracked()["attitude"].value).max() < 0.2


def test_an_attitude_integrated_from_a_perfect_gyro_is_the_true_one():
    log = ideal()
    found = attitude_of_start(log["gyro"], log["attitude"]).value
    off = rotation.multiply(rotation.conjugate(found), log["truth_attitude"].value)
    assert np.abs(rotation.to_rotation_vector(off)).max() < 2e-4


def test_noise_of_the_gyro_is_in_the_attitude_too():
    log = measured(ideal(), 4.7e-3, np.random.default_rng(1))
    gyro = log["gyro"].value - ideal()["gyro"].value
    assert gyro.std() == pytest.approx(4.7e-3, rel=0.03)
    off = rotation.multiply(rotation.conjugate(ideal()["attitude"].value), log["attitude"].value)
    # a random walk of 0.02 s steps over 60 s
    assert 5e-4 < np.linalg.norm(rotation.to_rotation_vector(off[-1])) < 2e-2


def test_an_attitude_of_the_start_alone_is_carried_on_by_the_gyro():
    log = as_handed_in(ideal(), 3).without_truth()
    motion = motion_of(log, machine())
    assert motion.time[-1] > 59.0
    off = rotation.multiply(
        rotation.conjugate(ideal()["attitude"].interpolated_at(motion.time)), motion.position
    )
    assert np.abs(rotation.to_rotation_vector(off)).max() < 3e-2


def test_where_the_papers_methods_are_wrong_by_half_prediction_error_is_within_its_intervals():
    platform, log = machine(), as_handed_in(ideal(), 3)
    bound = cramer_rao(platform, log, SCATTER)
    found = identify([log.without_truth()], as_guessed())
    trial = trial_of(found, platform, bound)
    assert found.misfit[0].is_noise
    # of nine that hang together
    assert np.all(np.abs(trial.error) < 4.0 * bound)
    np.testing.assert_allclose(trial.half, 1.96 * bound, rtol=0.3)


def test_no_published_inertia_of_table_4_is_a_body_and_the_nearest_is(monkeypatch):
    monkeypatch.setattr(paper_002, "TABLE4_SEEDS", range(5))
    rows = table4_compute(print).rows
    assert rows["002.table4.unphysical"].value == 0.0
    assert rows["002.table4.physical"].value is True


def test_a_moving_average_of_white_noise_leaves_one_over_the_root_of_its_width():
    (ours,) = fig9_compute(print).rows.values()
    width = samples(41.0, GYRO * natural_frequency(machine()))
    assert ours.value == pytest.approx(width**-0.5, rel=0.1)


def test_wheels_track_the_reference_body():
    assert fig4_compute(print).rows["002.fig4.tracking"].value < 0.02


def test_a_synchronised_log_is_where_an_estimate_turns():
    platform, log = machine(), ideal().without_truth()
    shifts = (-0.1, 0.0, 0.1)
    found = [identify([shifted(log, by)], platform, *METHODS["momentum_1"]) for by in shifts]
    jxx = [one.theta[0] for one in found]
    assert jxx[1] > max(jxx[0], jxx[2])
