"""A filter beside each segment says the same as the whole covariance of the samples at once."""

import numpy as np
from scipy.linalg import block_diag

from twin.predict.kalman import Linearised, Local, whitened


def test_whitening_agrees_with_the_dense_covariance():
    seed = 5
    print("seed", seed)
    rng = np.random.default_rng(seed)
    segments, instants, width, x, u, c = 2, 6, 2, 3, 2, 2
    measured = rng.normal(size=(segments, instants, width, x))
    carried = rng.normal(size=(segments, instants - 1, x, x)) * 0.6
    pushed = rng.normal(size=(segments, x, c))
    intensity = np.array([0.7, 0.2])
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
        np.zeros(x),
    )
    row = np.arange(rows, dtype=np.int32).reshape(1, instants, width).repeat(segments, axis=0)
    by_row = measured.reshape(segments, rows, x)
    driven = step * pushed[:, None]
    local = Local(by_row, row, carried, pushed, step, wander, drift, driven)
    white, logarithm = whitened(linear, local, intensity)

    total = 0.0
    for s in range(segments):
        noise = pushed[s] @ np.diag(intensity * step) @ pushed[s].T
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
