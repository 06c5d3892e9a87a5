"""Twins of the two shipped logs that have a rate alone: what is hidden comes back in its interval.

The logs are rolled out here, by plain MuJoCo, and written as a lab would hand them in.
"""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from twin.errors import UsageError
from twin.identification import Identification, calibrated, identify
from twin.model import MassProperties, compile_model, set_mass_properties
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series
from twin.report import identified

GAIN = 0.6
"""[V s/rad] of the gyro."""


def hidden(stated: Platform, rng: np.random.Generator) -> tuple[mujoco.MjModel, float]:
    """Its model with another J and other damping, and that J about the axis."""
    machine = compile_model(stated)
    inertia = stated.inertia * rng.uniform(0.93, 1.07)
    set_mass_properties(
        machine.model,
        machine.base_body,
        MassProperties(stated.mass, inertia, stated.center_of_mass_offset),
    )
    machine.model.dof_damping[:] *= rng.uniform(0.6, 1.5, machine.model.nv)
    axis = machine.model.jnt_axis[0]
    return machine.model, float(axis @ inertia @ axis)


def rolled(model: mujoco.MjModel, angle: float, duty: np.ndarray, every: int) -> np.ndarray:
    """Rate of the base at every so many steps of 5 ms, under the wheel's torque a step [N m]."""
    data = mujoco.MjData(model)
    model.opt.timestep = 0.005
    data.qpos[0] = angle
    rates = []
    for step, torque in enumerate(duty):
        if step % every == 0:
            rates.append(data.qvel[0])
        data.qfrc_applied[model.nv - 1] = torque
        mujoco.mj_step(model, data)
    return np.array(rates)


def a_log(name: str, rate: np.ndarray, every: int, unit: str, noise: float) -> dict[str, object]:
    time = 0.005 * every * np.arange(len(rate))
    return {
        "streams": {"joint_rate": Series(time, rate[:, None], (name,), "rad/s")},
        "provenance": {
            "streams": {"joint_rate": {"unit": unit, "noise": [noise], "fit_scale": unit == "V"}}
        },
    }


def swinging(
    seed: int, amplitude: float, steps: int = 4000
) -> tuple[Platform, Recording, mujoco.MjModel, float]:
    """A fork let go at some angle, its gyro in volts with an offset."""
    print("seed", seed)
    rng = np.random.default_rng(seed)
    stated = load_platform("bicycle_fork")
    model, inertia = hidden(stated, rng)
    rate = rolled(model, amplitude, np.zeros(steps), 2)
    volts = 1.3 + GAIN * rate + rng.normal(0.0, 0.003, len(rate))
    return stated, Recording(**a_log("axle", volts, 2, "V", 0.003)), model, inertia


def spun(seed: int) -> tuple[Platform, Recording, mujoco.MjModel, float]:
    """A CubeSat on its line under a step of duty; nobody measures the wheel."""
    print("seed", seed)
    rng = np.random.default_rng(seed)
    stated = load_platform("vnucec_cubesat")
    model, inertia = hidden(stated, rng)
    time = 0.005 * np.arange(9000)
    duty = np.where((time >= 5.0) & (time < 30.0), 0.5, 0.0)
    rate = rolled(model, 0.0, duty * stated.wheels[0].torque_limit, 20)
    rate = rate + rng.normal(0.0, 0.002, len(rate))
    log = a_log("line", rate, 20, "rad/s", 0.002)
    steps = Series(np.array([0.0, 5.0, 30.0]), np.array([[0.0], [0.5], [0.0]]), ("wheel",), "1")
    log["streams"]["command_wheel_duty"] = steps  # type: ignore[index]
    return stated, Recording(**log), model, inertia


def within(found: Identification, name: str, truth: float, widths: float = 1.6) -> None:
    """One of a few intervals of 95 % may miss by a little; 1.6 half widths are 99.8 %."""
    place = found.base.names.index(name)
    error, half = found.theta[place] - truth, found.half_widths[place]
    assert abs(error) < widths * half, f"{name}: off by {error / half:.2f} half widths"


def test_inertia_damping_and_scale_of_a_swinging_fork():
    stated, log, model, inertia = swinging(seed=11, amplitude=0.6)
    found = identify([log], stated)
    within(found, "J", inertia)
    within(found, "damping of axle", model.dof_damping[0])
    (scale,) = found.scales
    assert scale.known
    error, half = np.log(scale.value * GAIN), np.log(scale.high / scale.value)
    assert abs(error) < 1.6 * half, f"off by {error / half:.2f} half widths"
    assert half < 0.05, "a swing of 34 deg should tell the scale to 5 %"
    assert found.half_widths[0] < 0.01 * inertia, "known to a percent at least"


def test_a_small_swing_leaves_the_scale_open_and_says_so():
    stated, log, _, _ = swinging(seed=14, amplitude=0.03, steps=2000)
    found = identify([log], stated)
    (said,) = (one for one in found.not_excited if "same at any amplitude" in one)
    volts, rate = log["joint_rate"].value[:, 0], found.recordings[0]["joint_rate"].value[:, 0]
    assert f"{np.polyfit(volts, rate, 1)[0]:.3g} rad/s per V was taken" in said
    assert found.document()["scales"]["joint_rate"]["value"] is None
    with pytest.raises(UsageError, match="does not tell the scale"):
        calibrated(log, stated)


def test_body_and_motor_under_a_duty_that_nobody_measured_the_answer_of():
    stated, log, model, inertia = spun(seed=21)
    found = identify([log], stated)
    within(found, "J", inertia)
    within(found, "damping of line", model.dof_damping[0])
    within(found, "damping of wheel", model.dof_damping[1])
    assert found.misfit[0].is_noise
    assert any("torque_limit" in sentence for sentence in found.not_excited)


def test_samples_at_the_end_of_the_range_are_counted_and_left_out():
    stated, log, _, inertia = spun(seed=24)
    limit = 2.0
    sensors = {"joint_rate": replace(stated.sensors["joint_rate"], range=limit)}
    series = log["joint_rate"]
    flat = replace(series, value=np.clip(series.value, -limit, limit))
    cut = replace(log, streams={**log.streams, "joint_rate": flat})
    found = identify([cut], replace(stated, sensors=sensors))
    lost = int(np.count_nonzero(np.abs(flat.value) >= limit))
    assert lost > 50
    assert f"{lost} of {len(series)} samples of joint_rate" in "\n".join(identified(found))
    within(found, "J", inertia)


def test_the_method_momentum_refuses_what_it_cannot_know():
    stated, log, _, _ = spun(seed=25)
    with pytest.raises(UsageError, match="no wheel_speed"):
        identify([log], stated, "momentum")
    stated, log, _, _ = swinging(seed=26, amplitude=0.5)
    with pytest.raises(UsageError, match="cannot fit"):
        identify([log], stated, "momentum")
