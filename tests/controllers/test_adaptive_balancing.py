"""Masses that adapt while gyros or wheels hold or follow a momentum; and the following alone."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from papers.flown import perfect
from tests.controllers.flight import simulate
from twin.controller import load_controller
from twin.errors import ControllerError
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.reference import Reference
from twin.rotation import from_rotation_vector, tilt, vertical_body
from twin.signals import Target

TILTED = InitialState(attitude=from_rotation_vector(np.array([0.1, 0.0, 0.0])))


@dataclass(frozen=True)
class Cone(Reference):
    """Rates, and so momenta, of a body whose vertical goes round a cone; the attitude is unused."""

    angle: float
    """Half of the cone's [rad]."""
    pace: float
    """[rad/s]."""
    ramp: float = 30.0
    """[s]."""

    def at(self, time):
        """With a ramp that starts and ends without a step in acceleration."""
        turn, share = self.pace * np.asarray(time), np.clip(np.asarray(time) / self.ramp, 0.0, 1.0)
        size = np.sin(0.5 * np.pi * share)[..., None] ** 2
        growth = 0.5 * np.pi / self.ramp * np.sin(np.pi * share)[..., None]
        along = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=-1)
        across = np.stack([-np.sin(turn), np.cos(turn), 0.0 * turn], axis=-1)
        most = self.angle * self.pace
        level = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (*turn.shape, 4))
        acceleration = most * (growth * along + self.pace * size * across)
        return Target(level, most * size * along, acceleration)


def tuned(platform, *, gain, pace):
    """Adaptation at the pace of the excitation, b = pace^2."""
    adaptation = (pace / (platform.mass * platform.gravity)) ** 2
    return load_controller("adaptive_balancing", {"gain": gain, "adaptation": adaptation})


def parts(run):
    """m r along the vertical (m,) and across it (m,) [kg m]."""
    moment, up = run.true["center_of_mass_offset"], vertical_body(run.true["attitude"])
    return np.einsum("ni,ni->n", moment, up), np.linalg.norm(np.cross(moment, up), axis=1)


@pytest.mark.parametrize("name", ["tas2", "sads"], ids=["by gyros", "by wheels"])
def test_without_excitation_momentum_vanishes_and_the_cm_stays_on_the_vertical(name):
    """000 Fig. 3, top: the null vector of [g x]."""
    platform = perfect(load_platform(name))
    run = simulate(tuned(platform, gain=0.6, pace=0.3), platform, 80.0, start=TILTED)
    along, across = parts(run)
    momentum = np.linalg.norm(run.true["rate"] @ platform.inertia, axis=1)
    assert momentum[-1] < 1e-3 * momentum.max()
    assert across[-1] < 1e-2 * across[0]
    assert along[-1] == pytest.approx(along[0], rel=0.1), "nothing tells where along the vertical"


@pytest.mark.parametrize("name", ["tas2", "sads"], ids=["by gyros", "by wheels"])
def test_with_excitation_the_cm_comes_to_the_cr_as_fast_as_the_law_says(name):
    """000 Fig. 3, bottom; along the vertical as exp(-c t), c = <tilt^2> f^2 / K where b = f^2."""
    gain = pace = 0.4
    platform = perfect(load_platform(name))
    reference = Cone(np.radians(10.0), pace)
    run = simulate(tuned(platform, gain=gain, pace=pace), platform, 160.0, reference=reference)
    along, _ = parts(run)
    first, last = np.searchsorted(run.time, [60.0, 60.0 + 12.0 * np.pi / pace])  # six turns
    swing = np.mean(tilt(run.true["attitude"][first:last]) ** 2)
    rate = -np.log(along[last] / along[first]) / (run.time[last] - run.time[first])
    assert rate == pytest.approx(swing * pace**2 / gain, rel=0.1)
    moment = np.linalg.norm(run.true["center_of_mass_offset"], axis=1)
    print(f"{name}: CM from {moment[0] / platform.mass:.1e} to {moment[-1] / platform.mass:.1e} m")
    assert moment[-1] < 0.3 * moment[0]


def test_lyapunov_function_never_grows():
    """V = |H_s|^2 / 2 + |m r|^2 / (2 Gamma m^2), eq. 24 with its gain.

    Masses that are late by two ticks leave m r . (g x dH_s) of its rate, dH_s what changed since.
    """
    shipped = perfect(load_platform("sads"))
    ideal = {"speed": 1.0, "acceleration": 100.0, "resolution": 0.0}
    stages = tuple(replace(stage, **ideal) for stage in shipped.stages)
    platform = replace(shipped, stages=stages, control_rate=100.0)
    law = tuned(platform, gain=0.6, pace=0.3)
    run = simulate(law, perfect(platform), 30.0, start=TILTED)
    inertia = law.init(platform, 1).exchange.inertia
    momentum, moment = run.true["rate"] @ inertia, run.true["center_of_mass_offset"]
    value = 0.5 * np.sum(momentum**2, axis=1)
    value += 0.5 * np.sum(moment**2, axis=1) / (law.adaptation * platform.mass**2)
    late = 2.0 * np.linalg.norm(np.diff(momentum, axis=0), axis=1).max()
    slack = platform.gravity * parts(run)[1].max() * late * platform.tick
    assert np.diff(value).max() < slack
    assert value[0] - value[-1] > 100.0 * slack


def test_stages_are_asked_for_no_more_than_their_speed_and_the_cm_keeps_its_direction(sads):
    law = load_controller("adaptive_balancing", {"adaptation": 1.0})
    start = InitialState(rate_body=np.array([0.02, -0.01, 0.0]))
    run = simulate(law, perfect(sads), 0.1, start=start)
    asked = run.applied["command_stage_position"][0]
    assert np.abs(asked).max() == pytest.approx(sads.stages[0].speed * sads.tick, abs=1e-6)
    # H x g of a level body: along (-H_y, H_x), H = J w with J = (3, 12, 12) but for the wheels
    assert asked[1] / asked[0] == pytest.approx(3.0 * 0.02 / (12.0 * 0.01), rel=0.02)


def test_adaptation_begins_where_the_stages_stand():
    platform = perfect(load_platform("tas2"))
    start = InitialState(stage_position=np.array([0.01, -0.02, 0.03]))
    run = simulate(load_controller("adaptive_balancing"), platform, 1.0, start=start)
    assert np.abs(run.true["stage_position"] - [0.01, -0.02, 0.03]).max() < 1e-3


@pytest.mark.parametrize("name", ["tas2", "sads"], ids=["by gyros", "by wheels"])
def test_momentum_error_of_a_balanced_body_decays_at_the_gain(name):
    balanced = replace(perfect(load_platform(name)), center_of_mass_offset=np.zeros(3))
    law = load_controller("momentum_tracking", {"gain": 0.5})
    start = InitialState(rate_body=np.array([0.005, -0.004, 0.006]))
    run = simulate(law, balanced, 6.0, start=start, reference=Cone(0.0, 0.4))
    size = np.linalg.norm(run.true["rate"] @ law.init(balanced, 1).inertia, axis=1)
    second = round(1.0 / balanced.tick)
    assert size[5 * second] / size[second] == pytest.approx(np.exp(-0.5 * 4.0), rel=0.05)
    assert np.diff(size).max() < 1e-4 * size[0]


def test_unbalanced_body_keeps_a_momentum_that_gravity_and_gain_agree_on(sads):
    law, platform = load_controller("momentum_tracking"), perfect(sads)
    run = simulate(law, platform, 8.0)
    torque = platform.gravity * np.hypot(*platform.center_of_mass_offset[:2])
    momentum = np.linalg.norm(run.true["rate"][-1] @ platform.inertia)
    assert momentum == pytest.approx(torque / law.gain, rel=0.05)


@pytest.mark.parametrize(
    ("name", "sentence"),
    [("cubesat", "the 0 wheels of cubesat do not"), ("dfki_pendulum", "the 0 stages of")],
)
def test_machine_without_gyros_wheels_or_masses_is_refused(name, sentence):
    with pytest.raises(ControllerError, match=sentence):
        load_controller("adaptive_balancing").init(load_platform(name), 1)
