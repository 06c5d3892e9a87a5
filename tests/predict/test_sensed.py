"""Tilt, specific force and field are predicted from the motion, as are the streams of its state."""

from dataclasses import replace

import numpy as np
import pytest

from tests.predict.flights import flown, predictor
from twin.clock import SimulatedClock
from twin.comparison.account import misfits
from twin.controller.load import load_controller
from twin.errors import UsageError
from twin.estimators.named import load_estimator
from twin.identification.prediction_error import Fit, fit
from twin.identification.start import base_of, first_biases
from twin.loop import fly
from twin.model import compile_model
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.innovations import Problem
from twin.predict.logs import motion_of
from twin.predict.sensors import SENSED
from twin.predict.states import PathForces
from twin.recording import Recording, Series
from twin.reference import parse_reference
from twin.stream.recorder import MemoryRecorder

SEED = 20261121
NOISE = 1e-4
"""Of a sharp accelerometer [m/s^2]."""


@pytest.fixture(scope="module")
def tas2() -> Body:
    return predictor(flown("tas2", SEED), "tas2")


def refitted(body: Body) -> tuple[Problem, Fit]:
    _, base = base_of(body.machine, [body.recording])
    problem = Problem([body], base)
    return problem, fit(problem, problem.start(base.as_stated, [first_biases(body)]))


def test_what_a_platform_states_a_sensor_of_is_predicted(tas2: Body):
    assert {output.stream for output in tas2.outputs} >= set(SENSED)
    assert not set(tas2.not_predicted) & set(SENSED)


def test_a_forces_column_is_what_a_rollout_with_it_gives(tas2: Body):
    base = base_parameters(tas2.machine)
    force = np.zeros((tas2.grid.segments, tas2.grid.steps, tas2.machine.model.nv))
    force[..., tas2.machine.base_dof] = np.random.default_rng(SEED).uniform(-1.0, 1.0, 3)
    size = 1e-4
    one = tas2.linearise(base, base.as_stated, np.zeros(len(tas2.bias_scale)), tas2.start)
    columns, _ = tas2.force_columns(one, force[..., None])
    path = tas2.rollouts.paths(
        base.model(base.as_stated), tas2.start.batched(), PathForces(size * force)
    )
    rolled = tas2.cells.gather((tas2.rows(path)[0] - one.linear.residual) / size)
    for output, own, other in zip(
        tas2.outputs, tas2.cells.gather(columns[..., 0]), rolled, strict=True
    ):
        if output.sense is None:
            continue
        off = np.abs(own - other).max() / max(np.abs(other).max(), 1e-9)
        print(f"{output.stream}: off by {off:.1e} of the largest")
        assert off < 5e-3, output.stream


def test_the_filters_slope_is_that_of_what_a_sensor_shows(tas2: Body):
    base = base_parameters(tas2.machine)
    path = tas2.rollouts.paths(base.model(base.as_stated), tas2.start.batched())
    size, x = 1e-6, tas2.start.width
    for output in tas2.outputs:
        if output.sense is None:
            continue
        sense = replace(output.sense, sections=None, memory=0)
        slope = sense.slope(path)
        for number in range(6):
            moved = path.moved(size * np.eye(x)[number])
            found = (sense.shown(moved) - sense.shown(path))[0] / size
            np.testing.assert_allclose(slope[..., number], found, atol=1e-4 * np.abs(slope).max())


@pytest.mark.parametrize("name", ["tas2", "whorl1", "astros"])
def test_a_true_model_leaves_only_noise_of_them(name: str):
    print("seed", SEED)
    body = predictor(flown(name, SEED), name)
    problem, found = refitted(body)
    for part in misfits(problem, found.innovations):
        print(part.stream, part.column, f"{part.chi2:.3f} ({part.low:.3f} to {part.high:.3f})")
        if part.stream in SENSED:
            assert part.sigmas < 4.0, part


def test_a_filtered_gyro_on_a_table_that_glides_is_not_found_early_or_late():
    stated = load_platform("astros:mode_c")
    sensors = {name: stated.sensors[name] for name in ("gyro", "attitude")}
    sensors["gyro"] = replace(sensors["gyro"], noise=np.full(3, 1e-5))
    platform = replace(stated, sensors=sensors)
    recorder = MemoryRecorder(platform, {"platform": platform.name, "source": f"seed {SEED}"})
    with SimulatedPlant(platform, seed=SEED) as plant:
        law, estimator = load_controller("thruster_pd"), load_estimator("filter")
        reference = parse_reference("multisine:3")
        clock = SimulatedClock()
        fly(plant, estimator, law, reference, clock, duration=20.0, observers=[recorder])
    log = recorder.recording().without_truth()
    body = body_of(compile_model(platform), log, motion_of(log, platform))
    _, found = refitted(body)
    (gyro,) = (output for output in body.outputs if output.stream == "gyro")
    left = gyro.residual(found.innovations.exact[0].path, body.grid.step)[0]
    slope = np.gradient(gyro.value - left * gyro.sigma, gyro.time, axis=0) / gyro.sigma
    left -= left.mean(axis=0)
    late, spread = -np.sum(left * slope) / np.sum(slope**2), 1.0 / np.sqrt(np.sum(slope**2))
    print(f"late by {1e3 * late:.3f} +- {1e3 * spread:.3f} ms")
    assert abs(late) < 4.0 * spread


@pytest.mark.parametrize(("part", "window"), [(0.5, 0.01), (1.0, 0.03), (1.0, 0.036)])
def test_an_accelerometers_window_is_predicted_as_it_is_simulated(part: float, window: float):
    """Under pulses of thrusters, which other windows show otherwise; on any step."""
    stated = load_platform("whorl1")
    sensors = {name: stated.sensors[name] for name in ("gyro", "attitude", "accelerometer")}
    sharp = replace(sensors["accelerometer"], noise=np.full(3, NOISE), window=window)
    platform = replace(stated, sensors=sensors | {"accelerometer": sharp})
    recorder = MemoryRecorder(platform, {"platform": platform.name, "source": f"seed {SEED}"})
    hidden = replace(platform, step=part * platform.step)
    with SimulatedPlant(hidden, seed=SEED) as plant:
        law, estimator = load_controller("thruster_pd"), load_estimator("filter")
        reference, clock = parse_reference("multisine:2"), SimulatedClock()
        fly(plant, estimator, law, reference, clock, duration=20.0, observers=[recorder])
    log = recorder.recording().without_truth()
    left: dict[float, float] = {}
    for believed in (window, 0.0):
        sensor = replace(sharp, window=believed)
        machine = replace(platform, sensors=sensors | {"accelerometer": sensor})
        body = body_of(compile_model(machine), log, motion_of(log, machine))
        _, found = refitted(body)
        (felt,) = (output for output in body.outputs if output.stream == "accelerometer")
        off = felt.residual(found.innovations.exact[0].path, body.grid.step)[0] * felt.sigma
        left[believed] = float(np.std(off - off.mean(axis=0)) / NOISE)
    print(f"leaves {left[window]:.3f} of its noise, with another window {left[0.0]:.3f}")
    # of 3000 numbers; a little more, for the step of the prediction
    assert left[window] < 1.1
    assert left[0.0] > 1.2 or window == platform.step, "the window shows"


def without(log: Recording, *names: str) -> Recording:
    return replace(log, streams={n: s for n, s in log.streams.items() if n not in names})


@pytest.mark.parametrize("tilt", ["inclinometer", "accelerometer"])
def test_a_tilt_and_a_gyro_are_enough_to_predict_by(tilt: str):
    print("seed", SEED)
    others = {"attitude", "magnetometer", "inclinometer", "accelerometer"} - {tilt}
    body = predictor(without(flown("tas2", SEED, 25.0), *others), "tas2")
    problem, found = refitted(body)
    platform = body.machine.platform
    entries = [(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)]
    truth = [*(platform.inertia[i, j] for i, j in entries), *platform.center_of_mass_offset]
    off = found.at.theta[:9] - truth
    distance = float(off @ np.linalg.solve(found.covariance()[0][:9, :9], off))
    print(f"squared distance from the truth {distance:.1f}, 9 is due")
    # a chi-square of 9 degrees of freedom is larger once in 1000
    assert distance < 27.9
    assert all(part.sigmas < 4.0 for part in misfits(problem, found.innovations))


def test_a_log_that_shows_no_tilt_is_refused():
    log = without(flown("tas2", SEED), "attitude", "inclinometer", "accelerometer")
    with pytest.raises(UsageError, match="nor gyro and inclinometer or accelerometer"):
        predictor(log, "tas2")


def test_a_hinge_with_a_gyro_alone_is_refused_with_the_column_to_name():
    time = np.arange(0.0, 20.0, 0.01)
    rate = np.cos(4.4 * time)
    gyro = Series(time, np.column_stack([0.01 * rate, rate, 0.0 * rate]), ("x", "y", "z"), "rad/s")
    with pytest.raises(UsageError, match=r"turns most about y: .*\[streams.joint_rate\]"):
        motion_of(Recording({"gyro": gyro}), load_platform("dfki_pendulum"))
