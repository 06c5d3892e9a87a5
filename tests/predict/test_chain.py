"""Taking the states out of a chain of segments is the same as solving for all of them at once."""

from dataclasses import replace

import numpy as np
import pytest

from twin.errors import TwinError
from twin.predict.kalman import Linearised, chain, growth


def random_chain(
    seed: int, segments: int = 5, rows: int = 12, x: int = 3, u: int = 2
) -> Linearised:
    print("seed", seed)
    rng = np.random.default_rng(seed)
    noise = rng.normal(size=(segments - 1, x, x))
    return Linearised(
        rng.normal(size=(segments, rows)),
        rng.normal(size=(segments, rows, x)),
        rng.normal(size=(segments, rows, u)),
        rng.normal(size=(segments - 1, x)),
        rng.normal(size=(segments - 1, x, x)),
        rng.normal(size=(segments - 1, x, u)),
        0.1 * noise @ noise.transpose(0, 2, 1),
        np.zeros(x),
    )


def solved_at_once(linear: Linearised) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
    """States, shared unknowns, their covariance and chi-square by one dense least squares."""
    segments, rows, x = linear.state.shape
    u = linear.shared.shape[-1]
    matrix, right = [], []
    for s in range(segments):
        block = np.zeros((rows, segments * x + u))
        block[:, s * x : (s + 1) * x] = linear.state[s]
        block[:, segments * x :] = linear.shared[s]
        matrix.append(block)
        right.append(-linear.residual[s])
    for s in range(segments - 1):
        block = np.zeros((x, segments * x + u))
        block[:, s * x : (s + 1) * x] = linear.transition[s]
        block[:, (s + 1) * x : (s + 2) * x] = -np.eye(x)
        block[:, segments * x :] = linear.jump_shared[s]
        white = np.linalg.inv(np.linalg.cholesky(linear.spread[s]))
        matrix.append(white @ block)
        right.append(-white @ linear.jump[s])
    a, b = np.concatenate(matrix), np.concatenate(right)
    solution = np.linalg.lstsq(a, b, rcond=None)[0]
    left = a @ solution - b
    covariance = np.linalg.inv(a.T @ a)[segments * x :, segments * x :]
    return (
        solution[: segments * x].reshape(segments, x),
        solution[segments * x :],
        covariance,
        float(left @ left),
    )


def test_a_chain_is_one_least_squares():
    for seed in range(5):
        linear = random_chain(seed)
        link = chain(linear)
        states, shared, covariance, chi2 = solved_at_once(linear)
        ours = -np.linalg.lstsq(link.rows[:, 1:], link.rows[:, 0], rcond=None)[0]
        np.testing.assert_allclose(ours, shared, rtol=1e-6, atol=1e-9)
        normal = link.rows[:, 1:].T @ link.rows[:, 1:]
        np.testing.assert_allclose(np.linalg.inv(normal), covariance, rtol=1e-6)
        np.testing.assert_allclose(link.states(ours), states, rtol=1e-6, atol=1e-8)
        left = link.rows[:, 0] + link.rows[:, 1:] @ ours
        np.testing.assert_allclose(left @ left, chi2, rtol=1e-8)


def test_it_is_also_where_one_number_of_the_state_is_known_far_better_than_the_others():
    for seed in range(5):
        linear = random_chain(seed, rows=14)
        sharp = linear.state.copy()
        sharp[:, 10:] = 0.0
        sharp[:, 10:, -1] = 1e10
        linear = replace(linear, state=sharp)
        link = chain(linear)
        states, shared, _, chi2 = solved_at_once(linear)
        ours = -np.linalg.lstsq(link.rows[:, 1:], link.rows[:, 0], rcond=None)[0]
        # such a number leaves arithmetic six digits
        np.testing.assert_allclose(ours, shared, rtol=1e-5, atol=1e-6)
        np.testing.assert_allclose(link.states(ours), states, rtol=1e-5, atol=1e-6)
        left = link.rows[:, 0] + link.rows[:, 1:] @ ours
        np.testing.assert_allclose(left @ left, chi2, rtol=1e-5)


def test_hindsight_is_what_later_segments_still_change():
    for seed in range(5):
        linear = random_chain(seed, u=0)
        link = chain(linear)
        matrix = states_matrix(linear)
        covariance = np.linalg.inv(matrix.T @ matrix)
        x = linear.state.shape[-1]
        for s, change in enumerate(link.hindsight()):
            own = slice(s * x, (s + 1) * x)
            smoothed = link.seen_spread[s] - change
            np.testing.assert_allclose(smoothed, covariance[own, own], rtol=1e-6, atol=1e-9)


def states_matrix(linear: Linearised) -> np.ndarray:
    """Of the least squares of the states alone."""
    segments, rows, x = linear.state.shape
    blocks = []
    for s in range(segments):
        block = np.zeros((rows, segments * x))
        block[:, s * x : (s + 1) * x] = linear.state[s]
        blocks.append(block)
    for s in range(segments - 1):
        block = np.zeros((x, segments * x))
        block[:, s * x : (s + 1) * x] = linear.transition[s]
        block[:, (s + 1) * x : (s + 2) * x] = -np.eye(x)
        blocks.append(np.linalg.inv(np.linalg.cholesky(linear.spread[s])) @ block)
    return np.concatenate(blocks)


def test_a_motion_without_noise_needs_no_noise_to_be_solved():
    linear = random_chain(11)
    exact = Linearised(
        linear.residual,
        linear.state,
        linear.shared,
        linear.jump,
        linear.transition,
        linear.jump_shared,
        np.zeros_like(linear.spread),
        linear.known,
    )
    link = chain(exact)
    change = np.array([0.3, -0.2])
    states = link.states(change)
    for s in range(len(states) - 1):
        carried = linear.jump[s] + linear.transition[s] @ states[s] + linear.jump_shared[s] @ change
        np.testing.assert_allclose(states[s + 1], carried, rtol=1e-6, atol=1e-8)


def test_growth_is_that_of_the_directions_that_grow():
    linear = random_chain(3, segments=40, x=2)
    basis = np.random.default_rng(3).normal(size=(2, 2))
    falling = basis @ np.diag([np.exp(0.5), np.exp(-0.5)]) @ np.linalg.inv(basis)
    grown = growth(replace(linear, transition=np.tile(falling, (39, 1, 1))))
    np.testing.assert_allclose(grown, 0.5 * 39, atol=3.0)
    turn = np.array([[np.cos(0.3), -np.sin(0.3)], [np.sin(0.3), np.cos(0.3)]])
    assert growth(replace(linear, transition=np.tile(turn, (39, 1, 1)))) < 1e-9


def test_a_motion_that_grows_beyond_what_numbers_hold_is_refused_with_a_sentence():
    for factor in (1e200, np.nan):
        linear = random_chain(0)
        wild = replace(linear, transition=factor * linear.transition)
        with np.errstate(over="ignore", invalid="ignore"), pytest.raises(TwinError, match="grows"):
            chain(wild)
