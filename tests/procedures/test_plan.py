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


@pytest.mark.parametrize("sigmas", [0.0, 0.5, 1.0, 2.0, 50.0])
@pytest.mark.parametrize("spread", [(1, 1), (1, 1, 1), (1, 1, 30), (1, 30)])
def test_length_has_the_truth_in_its_interval_95_times_in_100(spread, sigmas):
    draw = np.random.default_rng(1)
    turn = np.linalg.qr(draw.normal(size=(len(spread), len(spread))))[0]
    root = 1e-7 * turn * np.array(spread)
    # so many standard deviations along each axis alike
    truth = sigmas * root @ np.ones(len(spread)) / np.sqrt(len(spread))
    lows, highs = np.transpose(
        [
            length(truth + root @ draw.normal(size=len(spread)), root @ root.T, 1.96)[1:]
            for _ in range(1000)
        ]
    )
    missed = np.mean(lows > np.linalg.norm(truth)), np.mean(highs < np.linalg.norm(truth))
    print(f"too high {missed[0]}, too low {missed[1]}")
    assert 0.005 < sum(missed) < 0.07, "fewer misses: wider than need be"


def test_length_is_not_taken_too_short_where_another_direction_is_known_far_worse():
    draw, spread = np.random.default_rng(3), np.array([1.0, 30.0])
    truth = 60.0 * np.array([0.8, 0.6])
    highs = [
        length(truth + spread * draw.normal(size=2), np.diag(spread**2), 1.96)[2]
        for _ in range(1000)
    ]
    assert np.mean(np.array(highs) < np.linalg.norm(truth)) < 0.04


def test_upper_end_of_a_length_is_no_less_than_that_of_the_component_along_it():
    draw = np.random.default_rng(2)
    for _ in range(200):
        vector, root = draw.normal(size=3), draw.normal(size=(3, 3)) * draw.exponential(size=3)
        along = np.linalg.norm(root.T @ vector) / np.linalg.norm(vector)
        size, low, high = length(vector, root @ root.T, 1.96)
        assert high >= size + 1.96 * along - 1e-12, "targets would be kept more easily"
        assert 0.0 <= low <= max(size - 1.96 * along, 0.0) + 1e-12


def test_length_of_what_is_known_exactly_is_exact():
    nothing = np.zeros((3, 3))
    assert length(np.array([3.0, 0.0, 4.0]), nothing, 1.96) == (5.0, 5.0, 5.0)
    assert length(np.zeros(3), nothing, 1.96) == (0.0, 0.0, 0.0)
