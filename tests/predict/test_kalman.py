"""A filter beside each segment says the same as the whole covariance of the samples at once."""

from dataclasses import replace

import numpy as np
from scipy.linalg import block_diag

from twin.predict.whitening.augmented import Local
from twin.predict.whitening.chain import chain
from twin.predict.whitening.kalman import whitened
from twin.predict.whitening.linearised import Linearised
from twin.predict.whitening.noise_model import QUIET, GaussMarkov, NoiseModel


def test_whitening_agrees_with_the_dense_covariance():
    seed = 5
    print("seed", seed)
    rng = np.random.default_rng(seed)
    segments, instants, width, x, u, c = 2, 6, 2, 3, 2, 2
    measured = rng.normal(size=(segments, instants, width, x))
    carried = rng.normal(size=(segments, instants - 1, x, x)) * 0.6
    pushed = rng.normal(size=(segments, x, c))
    intensity = 0.7
    half = rng.normal(size=(segments, instants - 1, x, 1))
    wander = 0.1 * half @ half.swapaxes(-1, -2)
    drift = rng.normal(size=(segments, instants - 1, x))
    step = 0.5
    rows = instants * width
    linear = Linearised(
        rng.normal(size=(segments, rows)),
        rng.normal(size=(segments, rows, x)),
        rng.normal(size=(segments, rows, u)),
        rng.normal(size=(segments - 1, x)),
        rng.normal(size=(segments - 1, x, x)),
        rng.normal(size=(segments - 1, x, u)),
        np.zeros((segments - 1, x, x)),
    )
    row = np.arange(rows, dtype=np.int32).reshape(1, instants, width).repeat(segments, axis=0)
    by_row = measured.reshape(segments, rows, x)
    local = Local(by_row, row, carried, pushed, step, wander, drift)
    white, logarithm = whitened(linear, local, NoiseModel(intensity))

    total = 0.0
    for s in range(segments):
        noise = intensity * step * pushed[s] @ pushed[s].T
        # the deviation at each instant as a linear map of the pushes before it
        maps = [np.zeros((x, (instants - 1) * x))]
        for k in range(1, instants):
            now = carried[s, k - 1] @ maps[-1]
            now[:, (k - 1) * x : k * x] += np.eye(x)
            maps.append(now)
        pushes = np.kron(np.eye(instants - 1), noise) + block_diag(*wander[s])
        seen = np.concatenate([measured[s, k] @ maps[k] for k in range(instants)])
        covariance = seen @ pushes @ seen.T + np.eye(rows)
        total += np.linalg.slogdet(covariance)[1]
        expected = maps[-1] @ drift[s].ravel()
        left_over = linear.residual[s] - seen @ drift[s].ravel()
        np.testing.assert_allclose(
            np.sum(np.square(white.residual[s])),
            left_over @ np.linalg.solve(covariance, left_over),
            rtol=1e-8,
        )
        for raw, ours in ((linear.shared[s], white.shared[s]), (linear.state[s], white.state[s])):
            np.testing.assert_allclose(
                ours.T @ ours, raw.T @ np.linalg.solve(covariance, raw), rtol=1e-8
            )
        if s == 0:
            gain = maps[-1] @ pushes @ seen.T @ np.linalg.inv(covariance)
            np.testing.assert_allclose(
                white.jump[0] - linear.jump[0], expected + gain @ left_over, rtol=1e-8
            )
            left = maps[-1] @ pushes @ maps[-1].T - gain @ seen @ pushes @ maps[-1].T
            np.testing.assert_allclose(white.spread[0], left, rtol=1e-7, atol=1e-10)
    np.testing.assert_allclose(logarithm, total, rtol=1e-8)


def drawn(rng: np.random.Generator) -> tuple[Linearised, Local]:
    """Two segments of a small machine, two streams of two columns each in every instant."""
    segments, instants, x, u, c = 2, 5, 3, 2, 2
    rows = 4 * instants
    linear = Linearised(
        rng.normal(size=(segments, rows)),
        rng.normal(size=(segments, rows, x)),
        rng.normal(size=(segments, rows, u)),
        rng.normal(size=(segments - 1, x)),
        rng.normal(size=(segments - 1, x, x)),
        rng.normal(size=(segments - 1, x, u)),
        np.zeros((segments - 1, x, x)),
    )
    row = np.arange(rows, dtype=np.int32).reshape(1, instants, 4).repeat(segments, axis=0)
    shown = {"attitude": np.zeros((segments, rows, 2)), "gyro": np.zeros((segments, rows, 2))}
    for k in range(instants):
        for column in range(2):
            shown["attitude"][:, 4 * k + column, column] = 1.0 / 0.3
            shown["gyro"][:, 4 * k + 2 + column, column] = 1.0 / 0.2
    local = Local(
        rng.normal(size=(segments, rows, x)),
        row,
        rng.normal(size=(segments, instants - 1, x, x)) * 0.6,
        rng.normal(size=(segments, x, c)),
        0.5,
        np.zeros((segments, instants - 1, x, x)),
        rng.normal(size=(segments, instants - 1, x)),
        shown,
    )
    return linear, local


def shown_by(linear: Linearised, local: Local, noise: NoiseModel, sources: np.ndarray):
    """(S, N) what the residual is by the first start and by the noise's own draws, step by step."""
    instants, x = local.row.shape[1], linear.state.shape[-1]
    draws = iter(sources)

    def take(count: int) -> np.ndarray:
        return np.array([next(draws) for _ in range(count)])

    start = take(x)
    torque, error, walk = take(2), take(2), take(2)
    rows = np.zeros(linear.residual.shape)
    error_noise = noise.errors["attitude"]
    for s in range(len(rows)):
        moved = np.zeros(x)
        for k in range(instants):
            if k:
                before = torque
                decay = noise.torque.decay(local.step)
                torque = decay * torque + np.sqrt(1.0 - decay**2) * take(2)
                half = 0.5 * local.step * noise.torque.rms * local.pushed[s]
                moved = local.carried[s, k - 1] @ (moved + half @ before) + half @ torque
                decay = error_noise.decay(local.step)
                error = decay * error + np.sqrt(1.0 - decay**2) * take(2)
                walk = walk + np.sqrt(local.step) * take(2)
            for at in local.row[s, k]:
                rows[s, at] = local.measured[s, at] @ moved - linear.state[s, at] @ start
                rows[s, at] += error_noise.rms * local.shown["attitude"][s, at] @ error
                rows[s, at] += noise.walks["gyro"] * local.shown["gyro"][s, at] @ walk
        if s == 0:
            start = linear.transition[0] @ start + moved
    return rows


def test_what_wanders_is_as_likely_as_the_whole_covariance_at_once_has_it():
    seed = 6
    print("seed", seed)
    linear, local = drawn(np.random.default_rng(seed))
    noise = NoiseModel(
        torque=GaussMarkov(0.8, 1.5),
        errors={"attitude": GaussMarkov(0.4, 4.0)},
        walks={"gyro": 0.3},
        scales={"attitude": 1.3, "gyro": 0.8},
    )
    expected = replace(local, drift=np.zeros_like(local.drift))
    x, sources = 3, 3 + 6 + 2 * 4 * 6
    maps = np.stack(
        [shown_by(linear, expected, noise, unit).ravel() for unit in np.eye(sources)], axis=1
    )
    # what neither a start nor a draw makes: the drift, and the jump between the segments
    known = np.zeros(linear.residual.shape)
    start, moved = np.zeros(x), np.zeros(x)
    for s in range(2):
        moved = np.zeros(x)
        for k in range(local.row.shape[1]):
            if k:
                moved = local.carried[s, k - 1] @ moved + local.drift[s, k - 1]
            for at in local.row[s, k]:
                known[s, at] = local.measured[s, at] @ moved - linear.state[s, at] @ start
        if s == 0:
            start = linear.jump[0] + moved
    scale = np.where(local.shown["attitude"].any(axis=-1), 1.3, 0.8).ravel()
    left = (linear.residual - known).ravel()
    free, own = maps[:, :x], maps[:, x:]
    covariance = own @ own.T + np.diag(scale**2)
    inverse = np.linalg.inv(covariance)
    normal = free.T @ inverse @ free
    told = inverse - inverse @ free @ np.linalg.solve(normal, free.T @ inverse)
    dense = np.linalg.slogdet(covariance)[1] + np.linalg.slogdet(normal)[1]

    white, logarithm = whitened(linear, local, noise)
    link = chain(white)
    np.testing.assert_allclose(np.sum(np.square(link.rows[:, 0])), left @ told @ left, rtol=1e-8)
    np.testing.assert_allclose(logarithm + link.logarithm, dense, rtol=1e-8)


def test_no_noise_beside_the_sensors_leaves_a_prediction_as_it_was():
    linear, local = drawn(np.random.default_rng(7))
    local = replace(local, drift=np.zeros_like(local.drift))
    none = QUIET.with_error("attitude", GaussMarkov(0.0, 3.0)).with_walk("gyro", 0.0)
    for noise in (QUIET, none.with_scale("gyro", 1.0)):
        white, logarithm = whitened(linear, local, noise)
        assert white is linear
        assert logarithm == 0.0
