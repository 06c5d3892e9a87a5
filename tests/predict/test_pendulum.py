"""The prediction of a passive pendulum against theory."""

import numpy as np
import pytest
from scipy.special import ellipj, ellipk

from twin.platform import Platform
from twin.predict.base import base_parameters
from twin.predict.compare import prepare
from twin.predict.rollout import Predictor
from twin.predict.segments import Segment
from twin.recording import Recording, Series

AMPLITUDE = 2.0
"""[rad], far from small."""


def passive_log(platform: Platform, duration: float) -> Recording:
    """The exact motion of a pendulum let go at `AMPLITUDE`, from Jacobi's elliptic functions."""
    inertia = float(platform.inertia[1, 1])
    moment = -float(platform.center_of_mass_offset[2])
    natural = np.sqrt(platform.gravity * moment / inertia)
    time = np.arange(0.0, duration, 0.005)
    k = np.sin(0.5 * AMPLITUDE)
    sn, cn, dn, _ = ellipj(ellipk(k**2) - natural * time, k**2)
    angle = 2.0 * np.arcsin(k * sn)
    rate = -2.0 * natural * k * cn
    del dn
    return Recording(
        {
            "joint_angle": Series(time, angle[:, None], ("pivot",), "rad"),
            "joint_rate": Series(time, rate[:, None], ("pivot",), "rad/s"),
        }
    )


@pytest.fixture(scope="module")
def passive(pendulum: Platform) -> Predictor:
    """One stretch of 14 periods, predicted from its first sample."""
    log = passive_log(pendulum, 20.0)
    predictor, _ = prepare(log, pendulum)
    whole = (Segment(0.0, float(log.stop)),)
    return Predictor(predictor.machine, log, predictor.motion, whole)


def test_the_predicted_pendulum_keeps_its_energy(passive: Predictor, pendulum: Platform):
    model = passive.machine.model
    qpos, qvel = passive.rollout(model, np.zeros(1, dtype=int), np.zeros((1, 2)))
    moment = -float(pendulum.center_of_mass_offset[2])
    energy = 0.5 * pendulum.inertia[1, 1] * qvel[0, :, 0] ** 2
    energy = energy - pendulum.gravity * moment * np.cos(qpos[0, :, 0])
    swing = pendulum.gravity * moment * (1.0 - np.cos(AMPLITUDE))
    assert np.ptp(energy) < 1e-8 * swing


def test_the_predicted_pendulum_keeps_the_time_of_the_elliptic_integral(passive: Predictor):
    base = base_parameters(passive.machine)
    start = passive.motion.at(np.zeros(1))
    exact = np.array([[AMPLITUDE - start.position[0, 0], -start.rate[0, 0]]])
    (residual,) = passive.predict(base.model(base.as_stated), np.zeros(1, dtype=int), exact)
    angle = passive.split(0, residual)["joint_angle"][1]
    rate = passive.split(0, residual)["joint_rate"][1]
    # what is left at a sample between two steps is the interpolation's
    assert np.max(np.abs(angle)) < 1e-6, "the period is off"
    assert np.max(np.abs(rate)) < 1e-4
