"""Vertical balancing comes from below, and what is not known is not acted upon."""

import numpy as np
import pytest

from twin.procedures.plan import MARGIN, SIGMAS, Aim, length

AIM = Aim(torque=4.3e-5, gravity=9.81)


def covariance(sigma: float) -> np.ndarray:
    return np.diag(np.full(3, sigma**2))


@pytest.mark.parametrize("height", [-1e-3, -3e-5, -5e-6])
@pytest.mark.parametrize("sigma", [0.0, 1e-7, 1e-6])
def test_height_is_raised_by_half_at_most_and_stays_below(height, sigma):
    change = AIM.change(np.array([1e-4, -1e-4, height]), covariance(sigma), in_plane=True)
    assert change[2] <= 0.5 * abs(height)
    assert height + change[2] + SIGMAS * sigma <= -MARGIN * AIM.moment + 1e-18


def test_cm_above_is_brought_down_at_once():
    change = AIM.change(np.array([0.0, 0.0, 1e-5]), covariance(1e-7), in_plane=True)
    assert 1e-5 + change[2] + SIGMAS * 1e-7 <= -MARGIN * AIM.moment


def test_plane_is_left_alone_where_a_law_takes_care_of_it():
    moment = np.array([1e-4, -1e-4, -1e-3])
    assert not AIM.change(moment, covariance(1e-7), in_plane=False)[:2].any()
    np.testing.assert_allclose(AIM.change(moment, covariance(1e-7), in_plane=True)[:2], -moment[:2])


@pytest.mark.parametrize("height", [-1.6e-3, -1.2e-3, -4.2e-6, -2e-6])
def test_halving_ends_where_it_is_aimed_wherever_it_began(height):
    moment = np.array([2e-4, 1e-4, height])
    for _ in range(12):
        change = AIM.change(moment, covariance(1e-8), in_plane=True)
        if AIM.is_kept(moment, covariance(1e-8), 1.96) and not AIM.is_worth(change):
            break
        moment = moment + change
    assert AIM.is_kept(moment, covariance(1e-8), 1.96)
    assert np.linalg.norm(moment) == pytest.approx(0.5 * AIM.moment, rel=0.5)


def test_wide_interval_does_not_count_as_reached():
    moment = np.array([0.0, 0.0, -2e-6])
    assert AIM.is_kept(moment, covariance(1e-8), 1.96)
    assert not AIM.is_kept(moment, covariance(1.5e-6), 1.96)
    assert not AIM.is_known(moment, covariance(1.5e-6))


def test_length_has_the_truth_in_its_interval_95_times_in_100():
    draw = np.random.default_rng(1)
    truth, root = np.array([3e-6, -1e-6, -4e-6]), 1e-7 * draw.normal(size=(3, 3))
    spread = root @ root.T
    hits = 0
    for _ in range(2000):
        _, low, high = length(truth + root @ draw.normal(size=3), spread, 1.96)
        hits += low <= np.linalg.norm(truth) <= high
    assert 0.93 < hits / 2000 < 0.97
