"""The parts of a prediction: commands, noise, segments, base parameters."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from twin.errors import TwinError, UsageError
from twin.model import compile_model, mass_properties
from twin.platform import Platform, load_platform
from twin.predict.base import base_parameters
from twin.predict.body import body_of
from twin.predict.inputs import Inputs, held_mean
from twin.predict.logs import motion_of, noise_of
from twin.predict.response import GROWTH, Segment, growth_rate
from twin.recording import Recording, Series


def test_a_command_that_changes_within_a_step_keeps_its_impulse():
    command = Series(np.array([0.0, 0.25, 0.9]), np.array([[1.0], [3.0], [-1.0]]), ("m",), "N m")
    edges = np.array([-0.5, 0.0, 0.5, 1.0, 2.0])
    np.testing.assert_allclose(held_mean(command, edges)[:, 0], [1.0, 2.0, 2.2, -1.0])


def test_a_command_of_one_row_holds_to_the_end_of_the_log(
    swing: Callable[..., Recording], pendulum: Platform
):
    log, machine = swing(seed=3), compile_model(pendulum)
    stream = "command_joint_torque"

    def push(rows: int) -> np.ndarray:
        time = np.linspace(log.start, log.stop, rows) if rows > 1 else np.array([log.start])
        held = replace(log[stream], time=time, value=np.full((rows, 1), 0.4))
        inputs = Inputs(machine, replace(log, streams={**log.streams, stream: held}))
        assert stream in inputs.used
        return inputs.drive(Segment(log.start, log.start + 5.0)).force

    np.testing.assert_allclose(push(1), push(50), rtol=1e-9)
    assert push(1).any()


@pytest.mark.parametrize("stream", ["gyro", "attitude"])
def test_a_stream_that_lacks_an_axis_is_named_with_its_columns(stream: str):
    time = np.arange(0.0, 5.0, 0.01)
    whole = {
        "gyro": Series(time, np.zeros((500, 3)), ("x", "y", "z"), "rad/s"),
        "attitude": Series(time, np.tile([1.0, 0.0, 0.0, 0.0], (500, 1)), tuple("wxyz"), ""),
    }
    part = whole[stream]
    whole[stream] = replace(part, value=part.value[:, :1], columns=part.columns[:1])
    with pytest.raises(
        UsageError, match=rf"the log's {stream} has 1 columns \({part.columns[0]}\)"
    ):
        motion_of(Recording(whole, {}), load_platform("sads"))


def test_white_noise_is_measured_under_a_motion():
    generator = np.random.default_rng(5)
    time = np.arange(0.0, 20.0, 0.01)
    value = np.sin(2.0 * time)[:, None] + generator.normal(0.0, 1e-3, (len(time), 1))
    assert noise_of(Series(time, value, ("pivot",), "rad"))[0] == pytest.approx(1e-3, rel=0.1)


def test_a_coarse_reading_is_as_noisy_as_its_steps():
    time = np.arange(0.0, 20.0, 0.01)
    coarse = np.round(np.sin(0.1 * time) / 0.01)[:, None] * 0.01
    noise = noise_of(Series(time, coarse, ("pivot",), "rad"))[0]
    assert noise == pytest.approx(0.01 / np.sqrt(12.0), rel=0.2)


def test_smoothing_keeps_the_size_of_rate_and_acceleration(
    swing: Callable[..., Recording], pendulum: Platform
):
    log = swing(seed=8)
    motion = motion_of(log, pendulum)
    measured = log["joint_rate"].interpolated_at(motion.time)
    ratio = np.sum(motion.rate * measured) / np.sum(np.square(measured))
    assert ratio == pytest.approx(1.0, abs=5e-3)


def test_segments_cover_the_log_and_stay_short(swing: Callable[..., Recording], pendulum: Platform):
    machine = compile_model(pendulum)
    log = swing(seed=8)
    motion = motion_of(log, pendulum)
    grid = body_of(machine, log, motion).grid
    assert grid.begin == motion.time[0]
    assert grid.starts[-1] + grid.length >= motion.time[-1]
    assert grid.length * growth_rate(machine) < 1.1 * GROWTH


@pytest.mark.parametrize("name", ["sads", "dfki_pendulum"])
def test_a_model_with_other_base_parameters_has_them(name: str):
    machine = compile_model(load_platform(name))
    base = base_parameters(machine)
    theta = base.as_stated + 0.05 * base.scale * np.linspace(-1.0, 1.0, len(base.as_stated))
    made = mass_properties(base.model(theta), machine.base_body)
    entries = base.entries(theta)
    np.testing.assert_allclose(made.center_of_mass_offset, entries[6:], atol=1e-12)
    np.testing.assert_allclose(np.diag(made.inertia), entries[:3], rtol=1e-9)
    np.testing.assert_allclose(base.theta(entries), theta, rtol=1e-9, atol=1e-12)


def test_an_inertia_no_body_has_is_refused():
    base = base_parameters(compile_model(load_platform("sads")))
    theta = base.as_stated.copy()
    theta[0] = -1.0
    with pytest.raises(TwinError, match="is no body's"):
        base.model(theta)


def test_a_hinge_says_what_it_cannot_see(pendulum: Platform):
    base = base_parameters(compile_model(pendulum))
    assert base.names == ("J", "mr_x", "mr_z")
    assert base.not_excited == ("J but about the axis y", "m r along the axis y")
