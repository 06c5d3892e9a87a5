"""The filter of three offsets: right, honest about its error, whatever moves on the machine."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.errors import UsageError
from twin.estimators import OffsetFilter, load_estimator
from twin.estimators.offset_filter import Gyrostat, MotionState, rate_of
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import parse_reference
from twin.rotation import conjugate, from_rotation_vector, multiply, to_rotation_vector

SEED = 11


class Last:
    """The last estimate, and what was true then."""

    def collect(self, tick):
        self.estimate, self.truth = tick.estimate, tick.truth


def machine_with(name, offset, bias=1e-3):
    """Without its effects, which no filter of it knows."""
    platform = load_platform(name)
    gyro = dataclasses.replace(platform.sensors["gyro"], bias=np.full(3, bias))
    return dataclasses.replace(
        platform,
        sensors={**platform.sensors, "gyro": gyro},
        center_of_mass_offset=platform.mass * np.array(offset),
        effects=(),
    )


def flown(platform, law, duration, runs, reference="hold", turned=(0.0, 0.1, 0.0), quiet=True):
    """The last tick; `quiet`: the filter knows that no other torque acts."""
    start = InitialState(attitude=from_rotation_vector(np.array(turned)))
    plant = SimulatedPlant(platform, runs=range(runs), seed=SEED, initial=start)
    estimator = OffsetFilter(torque_noise=0.0, wheel_noise=0.0) if quiet else OffsetFilter()
    last = Last()
    controller = load_controller(law) if isinstance(law, str) else law
    target, clock = parse_reference(reference), SimulatedClock()
    fly(plant, estimator, controller, target, clock, duration=duration, observers=(last,))
    assert not plant.stopped, plant.stopped
    return last


def squared_in_sigmas(last):
    """Normalised error squared of m r in each run; its mean is 3 if the covariance is right."""
    truth = last.truth["truth_center_of_mass_offset"].value[:, 0]
    error = last.estimate.center_of_mass_offset - truth
    spread = np.linalg.inv(last.estimate.offset_covariance)
    return np.einsum("ni,nij,nj->n", error, spread, error)


CASES = {
    "free": (("astros", (-5e-6, 5e-6, -5e-5)), "free_float", "hold"),
    "wheels at work": (("sads", (1e-5, -1e-5, -3e-5)), "quaternion_pd", "multisine:5"),
}


@pytest.mark.parametrize(("machine", "law", "reference"), CASES.values(), ids=CASES)
def test_offset_is_as_far_off_as_its_covariance_says(machine, law, reference):
    runs = 20
    last = flown(machine_with(*machine), law, 15.0, runs, reference)
    low, high = chi2.ppf([0.005, 0.995], 3 * runs) / runs
    mean = squared_in_sigmas(last).mean()
    assert low < mean < high, f"seed {SEED}: {mean:.2f}, mean of 3 degrees of freedom"


@pytest.mark.parametrize(
    ("machine", "law", "reference"),
    [
        (("astros", (-5e-6, 5e-6, -3e-4)), "mass_pid", "hold"),
        (("tas2", (2e-5, -1e-5, -5e-5)), "cmg_pd", "multisine:3"),
    ],
    ids=["masses at work", "gyros at work"],
)
def test_offset_is_found_to_a_few_micrometres_while_parts_move(machine, law, reference):
    platform = machine_with(*machine)
    last = flown(platform, law, 15.0, 5, reference, quiet=False)
    truth = last.truth["truth_center_of_mass_offset"].value[:, 0]
    error = (last.estimate.center_of_mass_offset - truth) / platform.mass
    assert np.abs(error).max() < 3e-6, f"seed {SEED}"


def test_white_torque_that_nobody_stated_leaves_the_estimate_within_its_wider_covariance():
    last = flown(machine_with("sads", (1e-5, -1e-5, -3e-5)), "free_float", 15.0, 10, quiet=False)
    assert squared_in_sigmas(last).mean() < 6.0
    sigma = np.sqrt(np.diagonal(last.estimate.offset_covariance, axis1=1, axis2=2))
    assert sigma[:, :2].max() < 1e-2


def test_attitude_rate_and_bias_are_those_of_the_machine():
    last = flown(machine_with("astros", (-5e-6, 5e-6, -5e-5)), "free_float", 20.0, 3)
    attitude, rate = (last.truth[name].value[:, 0] for name in ("truth_attitude", "truth_rate"))
    off = to_rotation_vector(multiply(conjugate(last.estimate.attitude), attitude))
    assert np.abs(off).max() < 1e-4
    assert np.abs(last.estimate.rate_body - rate).max() < 5e-5
    assert np.abs(last.estimate.gyro_bias).max() > 3e-4, "drawn with 1 sigma of 1e-3 rad/s"


@pytest.mark.parametrize("name", ["astros", "sads", "tas2"])
def test_model_arrives_where_mujoco_does_after_all_parts_have_moved(name):
    """Parts are driven for a second and then held, so that nothing hides within a tick."""
    platform = dataclasses.replace(load_platform(name), effects=())
    start = InitialState(
        attitude=from_rotation_vector(np.array([0.02, -0.03, 0.1])),
        rate_body=np.array([0.02, -0.03, 0.05]),
    )
    plant = SimulatedPlant(platform, initial=start)
    widths, model, period = platform.commands, Gyrostat.of(platform), platform.tick
    driven = {
        "command_wheel_torque": 0.05,
        "command_gimbal_rate": 0.05,
        "command_stage_position": 5e-3,
    }

    def true():
        streams = {key: s.value[:, 0] for key, s in plant.truth().items()}
        parts = ("stage_position", "gimbal_angle", "wheel_speed")
        return streams, [streams.get(f"truth_{part}", np.zeros((1, 0))) for part in parts]

    plant.read(0.0)
    begin, (stages, gimbals, speeds) = true()
    parts = model.parts((stages, stages), (gimbals, gimbals), 0.0)
    rate = begin["truth_rate"]
    spins = model.wheel_inertia * (speeds + np.einsum("niw,ni->nw", parts.axes, rate))
    momentum = np.einsum("nij,nj->ni", parts.inertia, rate) + parts.held
    momentum = momentum + np.einsum("niw,nw->ni", parts.axes, spins)
    motion = MotionState(begin["truth_attitude"], momentum, spins)
    for tick in range(1, 41):
        works = tick <= 20
        command = {
            key: np.full((1, widths[key]), value if works or "stage" in key else 0.0)
            for key, value in driven.items()
            if key in widths
        }
        applied = plant.write(command)
        plant.read(tick * period)
        end, (after, angles, speeds) = true()
        parts = model.parts((stages, after), (gimbals, angles), period)
        torque = applied.get("command_wheel_torque", np.zeros((1, 0)))
        motion = model.moved(motion, platform.center_of_mass_offset[None], parts, torque, period)
        stages, gimbals = after, angles
    moved = to_rotation_vector(multiply(conjugate(begin["truth_attitude"]), end["truth_attitude"]))
    turn = to_rotation_vector(multiply(conjugate(motion.attitude), end["truth_attitude"]))
    assert np.abs(turn).max() < 1e-3 * np.abs(moved).max()
    assert np.abs(rate_of(parts, motion) - end["truth_rate"]).max() < 1e-3 * np.abs(rate).max()


def test_machine_without_an_attitude_sensor_is_told_what_would_do():
    whole = load_platform("astros")
    blind = dataclasses.replace(whole, sensors={"gyro": whole.sensors["gyro"]})
    with pytest.raises(UsageError, match="astros has no attitude; no estimator knows"):
        load_estimator("offset").init(blind, 1)


VERTICALS = [
    ("astros", ("gyro", "inclinometer")),
    ("astros", ("gyro", "accelerometer")),
    ("astros", ("inclinometer",)),
]


@pytest.mark.parametrize(("name", "kept"), VERTICALS, ids=lambda value: "-".join(value))
def test_offset_is_found_by_what_shows_the_vertical_alone(name, kept):
    whole = load_platform(name)
    others = {"attitude", "gyro", "inclinometer", "accelerometer"} - set(kept)
    sensors = {n: sensor for n, sensor in whole.sensors.items() if n not in others}
    if "accelerometer" in sensors:
        sensors["accelerometer"] = dataclasses.replace(sensors["accelerometer"], bias=np.zeros(3))
    platform = dataclasses.replace(whole, sensors=sensors, effects=())
    start = InitialState(attitude=from_rotation_vector(np.array([0.06, 0.03, 0.0])))
    plant = SimulatedPlant(platform, seed=3, initial=start)
    estimator = OffsetFilter(rate_start=0.05)
    names = load_controller("free_float"), parse_reference("hold"), SimulatedClock()

    last = Last()
    fly(plant, estimator, *names, duration=40.0, observers=[last])
    estimate, truth = last.estimate, last.truth["truth_center_of_mass_offset"]
    error = estimate.center_of_mass_offset[0] - truth.value[0, -1]
    size = np.linalg.norm(truth.value[0, -1])
    assert np.abs(error).max() < 2e-3 * size
    assert np.sqrt(np.diagonal(estimate.offset_covariance[0])).max() < 2e-3 * size


def test_coils_are_known_to_turn_the_body():
    platform = dataclasses.replace(load_platform("cubesat"), effects=())
    law = load_controller("magnetic_damping", {"derivative": 0.02})
    start = InitialState(attitude=from_rotation_vector(np.array([0.1, 0.05, 0.0])))
    last = Last()
    fly(
        SimulatedPlant(platform, seed=1, initial=start),
        OffsetFilter(torque_noise=1e-7),
        law,
        parse_reference("hold"),
        SimulatedClock(),
        duration=30.0,
        observers=[last],
    )
    error = (
        last.estimate.center_of_mass_offset - last.truth["truth_center_of_mass_offset"].value[:, -1]
    )
    sigma = np.sqrt(np.diagonal(last.estimate.offset_covariance, axis1=1, axis2=2))
    assert (np.abs(error) < 4.0 * sigma).all()
    assert sigma.max() < 1e-6 * platform.mass
