"""What is added to a prediction acts as it says, and its strength is found in a log that has it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from twin.comparison.symptoms import clock_lag, scale_factor
from twin.effects.body import BearingCoulombFriction
from twin.identification.prediction_error import fit
from twin.model import compile_model
from twin.platform import Platform
from twin.predict import added
from twin.predict.added import Added, formed
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.forces import Perturbation
from twin.predict.innovations import Problem
from twin.predict.logs import motion_of
from twin.predict.states import PathForces
from twin.recording import Recording

SEED = 20261121

Swings = Callable[..., Recording]


def predictor(log: Recording, platform: Platform) -> Body:
    return body_of(compile_model(platform), log, motion_of(log, platform))


def against_rate(body: Body) -> np.ndarray:
    """-w along the measured motion."""
    middle = body.grid.starts[:, None] + body.grid.step * (np.arange(body.grid.steps) + 0.5)
    rate = body.motion.at(middle.ravel()).rate
    force = np.zeros((*middle.shape, body.machine.model.nv))
    force[..., body.machine.base_dof] = -rate.reshape(*middle.shape, -1)
    return force


VISCOUS = Perturbation("bearing_viscous_friction", "N m s", force=against_rate)


def problem_of(log: Recording, platform: Platform, added: list[Perturbation]) -> Problem:
    base = base_parameters(compile_model(platform))
    return Problem([predictor(log, platform)], base, added)


def test_where_a_push_turns_a_body_whatever_its_inertia_a_heavier_one_under_more_moves_as_that(
    swing: Swings, pendulum: Platform
):
    body = predictor(swing(seed=SEED, duration=6.0), pendulum)
    base = base_parameters(body.machine)
    push = 0.3 * against_rate(body)
    one = body.linearise(base, base.as_stated, np.zeros(0), body.start, PathForces(push))
    columns = body.without(base, one, PathForces(push)).linear.shared
    k = one.path.rate.shape[-1]
    turned = np.einsum("snkf,snf->snk", one.answer[:, :, k : 2 * k], push)
    (place,) = np.flatnonzero([name.startswith("J") for name in base.names])
    size = 1e-5 * base.scale[place]
    theta = base.as_stated + size * np.eye(len(base.as_stated))[place]
    more = push.copy()
    more[..., body.machine.base_dof] += size * turned
    path = body.rollouts.paths(base.model(theta), body.start.batched(), PathForces(more))
    rolled = (body.rows(path)[0] - one.linear.residual) / size
    np.testing.assert_allclose(columns[..., place], rolled, atol=2e-3 * np.abs(rolled).max())
    with_it = np.abs(one.linear.shared[..., place] - rolled).max()
    assert with_it > 0.01 * np.abs(rolled).max()


def test_a_forces_column_is_what_a_rollout_with_it_gives(swing: Swings, pendulum: Platform):
    body = predictor(swing(seed=SEED, duration=6.0), pendulum)
    base = base_parameters(body.machine)
    force, size = against_rate(body), 1e-5
    one = body.linearise(base, base.as_stated, np.zeros(0), body.start)
    columns, jumps = body.force_columns(one, force[..., None])
    path = body.rollouts.paths(
        base.model(base.as_stated), body.start.batched(), PathForces(size * force)
    )
    rolled = (body.rows(path)[0] - one.linear.residual) / size
    scale = np.abs(rolled).max()
    np.testing.assert_allclose(columns[..., 0], rolled, atol=2e-3 * scale)
    pushed = body.linearise(base, base.as_stated, np.zeros(0), body.start, PathForces(size * force))
    ends = (pushed.linear.jump - one.linear.jump) / size
    np.testing.assert_allclose(jumps[..., 0], ends, atol=2e-3 * np.abs(ends).max())


def dry(size: float, body: Body) -> PathForces:
    law = BearingCoulombFriction(size, smoothing=0.05).torque(body.machine.platform)
    return PathForces(np.zeros_like(body.rollouts.force), ((1.0, law),))


def test_what_dry_friction_of_a_size_does_to_a_prediction_is_what_a_rollout_with_it_gives(
    swing: Swings, pendulum: Platform
):
    body = predictor(swing(seed=SEED, duration=4.0), pendulum)
    base = base_parameters(body.machine)
    one = body.linearise(base, base.as_stated, np.zeros(0), body.start)
    size = 2e-3
    friction = Perturbation("dry", "N m", laws=dry(1.0, body).laws, size=size)
    columns, _ = Added.to(body, (friction,)).force_columns(one, np.zeros(1))
    path = body.rollouts.paths(base.model(base.as_stated), body.start.batched(), dry(size, body))
    rolled = (body.rows(path)[0] - one.linear.residual) / size
    np.testing.assert_allclose(columns[..., 0], rolled, atol=0.02 * np.abs(rolled).max())


def test_a_lags_column_does_not_see_what_a_law_commands_afterwards(
    swing: Swings, pendulum: Platform
):
    body = predictor(swing(seed=SEED, duration=2.0), pendulum)
    base = base_parameters(body.machine)
    path = body.rollouts.paths(base.model(base.as_stated), body.start.batched())
    lag = Added.to(body, (clock_lag("joint_rate"),))
    instant = body.grid.steps // 2
    later = replace(path, rate=path.rate.copy())
    later.rate[:, :, instant + 1 :] += 1.0
    before, after = (
        body.cells.gather(lag.sensor_columns(one, np.zeros(1))[0])[1] for one in (path, later)
    )
    (rate,) = (output for output in body.outputs if output.stream == "joint_rate")
    seen = (rate.place <= instant) & (rate.place > 0)
    np.testing.assert_array_equal(before[seen], after[seen])
    assert np.abs(before - after).max() > 0.0


def fitted(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Strengths and their 1 sigma."""
    found = fit(problem, problem.start(problem.base.as_stated, [np.zeros(0)]))
    assert found.converged
    count = len(problem.perturbations)
    return found.at.strengths, np.sqrt(np.diag(found.innovations.covariance))[-count:]


def test_a_hidden_friction_is_fitted_beside_the_base(swing: Swings, pendulum: Platform):
    print("seed", SEED)
    problem = problem_of(swing(seed=SEED, viscous=0.01), pendulum, [VISCOUS])
    strength, sigma = fitted(problem)
    assert strength[0] == pytest.approx(0.01, abs=4.0 * sigma[0])
    assert sigma[0] < 5e-4


def test_a_hidden_dry_friction_is_fitted_however_little_is_known_of_the_rate_near_rest(
    swing: Swings, pendulum: Platform
):
    print("seed", SEED)
    log = swing(seed=SEED, dry=0.05, angle_noise=3e-2, rate_noise=0.3)
    body = predictor(log, pendulum)
    friction = Perturbation("dry", "N m", laws=dry(1.0, body).laws)
    strength, sigma = fitted(problem_of(log, pendulum, [friction]))
    assert strength[0] == pytest.approx(0.05, abs=4.0 * sigma[0])
    assert sigma[0] < 0.01


def test_a_late_stream_and_a_wrong_scale_are_fitted_together(swing: Swings, pendulum: Platform):
    print("seed", SEED)
    log = swing(seed=SEED)
    rate = log["joint_rate"]
    wrong = replace(rate, time=rate.time + 0.02, value=rate.value * 1.03)
    log = replace(log, streams={**log.streams, "joint_rate": wrong})
    wrongs = [
        clock_lag("joint_rate"),
        scale_factor("joint_rate", 0),
    ]
    strength, sigma = fitted(problem_of(log, pendulum, wrongs))
    assert np.all(np.abs(strength - [0.02, 0.03]) < 4.0 * sigma)
    assert np.all(sigma < 2e-3)


def test_a_held_base_stays(swing: Swings, pendulum: Platform):
    log = swing(seed=SEED, inertia=0.15)
    base = base_parameters(compile_model(pendulum))
    problem = Problem([predictor(log, pendulum)], base, held=True)
    found = fit(problem, problem.start(base.as_stated, [np.zeros(0)]))
    np.testing.assert_allclose(found.at.theta, base.as_stated, rtol=1e-6, atol=1e-9)


def test_columns_formed_in_groups_are_those_formed_together(
    swing: Swings, pendulum: Platform, monkeypatch: pytest.MonkeyPatch
):
    problem = problem_of(swing(seed=SEED, duration=6.0), pendulum, [])
    (body,) = problem.bodies
    exact = problem.exact(problem.start(problem.base.as_stated, [np.zeros(0)]))
    late = Perturbation("late", "s", stream="joint_angle", late=lambda o: np.ones(len(o.time)))
    steady = replace(VISCOUS, name="steady", force=lambda of: 2.0 * against_rate(of))
    every = [VISCOUS, late, steady]
    together = formed(problem.bodies, exact, every)
    monkeypatch.setattr(added, "AT_ONCE", 1)
    for one, other in zip(formed(problem.bodies, exact, every), together, strict=True):
        for part, whole in zip(one[0], other[0], strict=True):
            np.testing.assert_allclose(part, whole, atol=1e-12 * np.abs(whole).max())
    assert all(np.any(columns) for ((columns, _),) in together)
    assert (
        body.cells.count
        == np.bincount(
            np.concatenate([np.repeat(o.segment, o.slot.shape[1]) for o in body.outputs])
        ).max()
    ), "a segment has a row for each of its samples, and none for instants without any"
