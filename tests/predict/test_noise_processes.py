"""Noise that wanders is whitened as its covariance says, and found in the size that it has."""

from dataclasses import replace

import numpy as np
import pytest

from twin.predict.kalman import Linearised, Local, NoiseProcess, Wander, blocked, chain, whitened

SEGMENTS, INSTANTS, WIDTH, X, U, C = 3, 8, 2, 2, 2, 2
STEP = 0.5
Log = tuple[Linearised, Local]
TORQUE, GYRO = Wander(0.7, 2.0), Wander(1.3, 5.0)
NOISE = NoiseProcess(torque=TORQUE, errors=(("gyro", GYRO),))


@pytest.fixture
def log() -> Log:
    """A prediction of a linear system whose states and errors are seen at each instant."""
    seed = 8
    print("seed", seed)
    rng = np.random.default_rng(seed)
    rows = INSTANTS * WIDTH
    carried = 0.6 * rng.normal(size=(SEGMENTS, INSTANTS - 1, X, X))
    pushed = rng.normal(size=(SEGMENTS, X, C))
    measured = rng.normal(size=(SEGMENTS, INSTANTS, WIDTH, X))
    maps = [np.broadcast_to(np.eye(X), (SEGMENTS, X, X))]
    for k in range(INSTANTS - 1):
        maps.append(carried[:, k] @ maps[-1])
    state = -np.concatenate([measured[:, k] @ maps[k] for k in range(INSTANTS)], axis=1)
    linear = Linearised(
        rng.normal(size=(SEGMENTS, rows)),
        state,
        rng.normal(size=(SEGMENTS, rows, U)),
        rng.normal(size=(SEGMENTS - 1, X)),
        maps[-1][:-1],
        rng.normal(size=(SEGMENTS - 1, X, U)),
        np.zeros((SEGMENTS - 1, X, X)),
        np.zeros(X),
    )
    row = np.arange(rows, dtype=np.int32).reshape(1, INSTANTS, WIDTH).repeat(SEGMENTS, axis=0)
    errors = rng.normal(size=(SEGMENTS, rows, 1))
    return linear, Local(
        measured.reshape(SEGMENTS, rows, X),
        row,
        carried,
        pushed,
        STEP,
        np.zeros((SEGMENTS, INSTANTS - 1, X, X)),
        np.zeros((SEGMENTS, INSTANTS - 1, X)),
        STEP * pushed[:, None],
        {"gyro": errors},
    )


def likelihood(linear: Linearised, local: Local) -> tuple[np.ndarray, float]:
    """The normal matrix (1 + u, 1 + u) of residual and shared columns, and the log-determinant."""
    white, own = whitened(linear, local, np.zeros(C), NOISE)
    link = chain(white)
    return link.rows.T @ link.rows, own + link.logarithm


def test_whitening_what_wanders_agrees_with_its_dense_covariance(log: Log):
    linear, local = log
    normal, logarithm = likelihood(linear, local)
    rows = linear.residual.shape[1]
    # every sample as a linear map of the first state, of all torques and of all errors
    torques, errors = SEGMENTS * (INSTANTS - 1) + 1, SEGMENTS * (INSTANTS - 1) + 1
    blocks = []
    reached = np.eye(X, X + C * torques)
    affine = np.zeros((X, 1 + U))
    for s in range(SEGMENTS):
        if s:
            affine = linear.transition[s - 1] @ affine
            affine += np.column_stack([linear.jump[s - 1], linear.jump_shared[s - 1]])
        local_moved = np.zeros_like(reached)
        for k in range(INSTANTS):
            at = s * (INSTANTS - 1) + k
            own = slice(k * WIDTH, (k + 1) * WIDTH)
            seen = np.zeros((WIDTH, reached.shape[1] + errors))
            seen[:, : reached.shape[1]] = (
                linear.state[s, own] @ reached - local.measured[s, own] @ local_moved
            )
            seen[:, reached.shape[1] + at] = -local.errors["gyro"][s, own, 0]
            shown = np.column_stack([linear.residual[s, own], linear.shared[s, own]])
            blocks.append((seen, shown + linear.state[s, own] @ affine))
            if k < INSTANTS - 1:
                local_moved = local.carried[s, k] @ local_moved
                local_moved[:, X + C * at : X + C * (at + 1)] += STEP * local.pushed[s]
        if s < SEGMENTS - 1:
            reached = linear.transition[s] @ reached + local_moved
    whole = np.concatenate([seen for seen, _ in blocks])
    shown = np.concatenate([part for _, part in blocks])
    first, random = whole[:, :X], whole[:, X:]

    def covariance(wander: Wander, count: int) -> np.ndarray:
        lags = STEP * np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
        return wander.rms**2 * np.exp(-lags / wander.time)

    spread = np.zeros((random.shape[1], random.shape[1]))
    spread[: C * torques, : C * torques] = np.kron(covariance(TORQUE, torques), np.eye(C))
    spread[C * torques :, C * torques :] = covariance(GYRO, errors)
    total = random @ spread @ random.T + np.eye(SEGMENTS * rows)
    inverse = np.linalg.inv(total)
    information = first.T @ inverse @ first
    # of the first state nothing is known: its restricted likelihood
    project = inverse - inverse @ first @ np.linalg.solve(information, first.T @ inverse)
    np.testing.assert_allclose(normal, shown.T @ project @ shown, rtol=1e-5, atol=1e-6)
    expected = np.linalg.slogdet(total)[1] + np.linalg.slogdet(information)[1]
    np.testing.assert_allclose(logarithm, expected, rtol=1e-6)


def test_blocks_in_which_nothing_wanders_say_the_same(log: Log):
    """With a correlation time far beyond the log's length."""
    linear, local = log
    slow = NoiseProcess(torque=Wander(0.7, 1e9), errors=(("gyro", Wander(1.3, 1e9)),))
    found = []
    for prediction, travels in (log, blocked(linear, local, 4 * STEP)):
        white, own = whitened(prediction, travels, np.zeros(C), slow)
        link = chain(white)
        found.append((link.rows.T @ link.rows, own + link.logarithm))
    np.testing.assert_allclose(found[1][0], found[0][0], rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(found[1][1], found[0][1], rtol=1e-6)


def test_without_memory_or_size_nothing_changes(log: Log):
    linear, local = log
    bare = chain(whitened(linear, local, np.zeros(C))[0])
    tiny = replace(NOISE, torque=Wander(1e-9, 2.0), errors=(("gyro", Wander(1e-9, 5.0)),))
    white, own = whitened(linear, local, np.zeros(C), tiny)
    link = chain(white)
    np.testing.assert_allclose(own + link.logarithm, bare.logarithm, atol=1e-6)
    np.testing.assert_allclose(
        link.rows.T @ link.rows, bare.rows.T @ bare.rows, rtol=1e-6, atol=1e-8
    )
