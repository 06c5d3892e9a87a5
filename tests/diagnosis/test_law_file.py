"""A law without a name, saved, is an effect that acts as the law does."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.cli.main import main
from twin.diagnosis.cause import Equation
from twin.diagnosis.extension import write_laws
from twin.diagnosis.laws import Law, sensor_laws, torque_laws
from twin.effects import BodyEffect, SeriesEffect, State, effect_named
from twin.effects.on_sensor import shown
from twin.model import compile_model
from twin.platform import load_platform
from twin.predict.body import Body, body_of
from twin.predict.forces import middles, plain_forces
from twin.predict.logs import motion_of
from twin.recording import open_log
from twin.signals import Samples


@pytest.fixture(scope="module")
def body(tmp_path_factory) -> Body:
    """20 s of a turning table."""
    run = tmp_path_factory.mktemp("run") / "run.rrd"
    fly = ["run", "sads", "--controller", "quaternion_pd", "--duration", "20"]
    assert main([*fly, "--rrd", str(run)]) == 0
    platform = load_platform("sads")
    log = open_log(run).without_truth()
    return body_of(compile_model(platform), log, motion_of(log, platform))


@pytest.fixture
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


def drawn(laws: Iterable[Law], rng: np.random.Generator) -> Equation:
    """Some of them with some sizes; a simulation's time is its own."""
    chosen = [law for law in laws if "time" not in law.factors]
    chosen = tuple(chosen[i] for i in rng.choice(len(chosen), min(12, len(chosen)), replace=False))
    sizes = rng.uniform(-0.1, 0.1, len(chosen))
    return Equation(chosen, sizes, 0.1 * np.abs(sizes), 1e3)


def test_a_saved_law_pushes_as_the_products_that_were_fitted(body, rng, tmp_path):
    platform = body.machine.platform
    equation = drawn(torque_laws([body]), rng)
    (path,) = write_laws(equation, platform, tmp_path)
    effect = effect_named(str(path)).typical("")
    assert isinstance(effect, BodyEffect)
    np.testing.assert_allclose(effect.values, equation.coefficients, rtol=1e-8)
    wanted = sum(
        size * law.perturbation.force(body)
        for size, law in zip(equation.coefficients, equation.laws, strict=True)
    )
    law = effect.torque(platform)
    assert law is not None
    machine, (here, _) = body.machine, plain_forces(body)
    base, wheels = machine.base_dof, machine.wheel_dof
    rate = here.velocity
    torque = law(
        State(here.position[:, machine.base_qpos], rate[:, base], rate[:, wheels], middles(body))
    )
    # nine digits of each size, of which the terms may cancel
    np.testing.assert_allclose(
        torque, wanted.reshape(len(torque), -1)[:, base], atol=1e-7 * np.abs(wanted).max()
    )


def test_a_wheel_may_be_called_what_python_may_not(body, tmp_path):
    known = body.machine.platform
    wheels = tuple(replace(wheel, name=f"rw-{wheel.name}") for wheel in known.wheels)
    platform = replace(known, wheels=wheels)
    one = replace(next(iter(torque_laws([body]))), column="x", factors=("speed_rw-w2",))
    (path,) = write_laws(Equation((one,), np.ones(1), np.ones(1), 1e3), platform, tmp_path)
    effect = effect_named(str(path)).typical("")
    assert isinstance(effect, BodyEffect)
    law = effect.torque(platform)
    assert law is not None
    speeds = np.array([[1.0, 2.0, 3.0]])
    torque = law(State(np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3)), speeds, np.zeros(1)))
    np.testing.assert_array_equal(torque, [[2.0, 0.0, 0.0]])


@pytest.mark.parametrize("stream", ["gyro", "attitude", "wheel_speed"])
def test_a_saved_law_of_a_sensor_shows_what_was_fitted(body, rng, tmp_path, stream):
    platform = body.machine.platform
    (output,) = (one for one in body.outputs if one.stream == stream)
    equation = drawn((law for law in sensor_laws([body]) if law.what == stream), rng)
    (path,) = write_laws(equation, platform, tmp_path)
    effect = effect_named(str(path)).typical("")
    assert isinstance(effect, SeriesEffect)
    truth = Samples(output.value[None], output.time[None], np.ones((1, len(output.time)), bool))
    error = sum(
        size * law.perturbation.shown(output, truth.value)
        for size, law in zip(equation.coefficients, equation.laws, strict=True)
    )
    wanted = shown(stream, truth.value, error)
    got = effect.apply(truth, platform).value
    np.testing.assert_allclose(got, wanted, atol=1e-7 * np.abs(wanted).max())
    # a few samples at a time it shows the same
    live = effect.live(platform)
    places = np.array_split(np.arange(len(output.time)), 7)
    bits = [Samples(truth.value[:, i], truth.time[:, i], truth.valid[:, i]) for i in places]
    np.testing.assert_array_equal(np.concatenate([live(bit).value for bit in bits], 1), got)


def test_what_a_saved_law_of_a_sensor_shows_can_be_undone(body, rng, tmp_path):
    platform = body.machine.platform
    (output,) = (one for one in body.outputs if one.stream == "gyro")
    mixed = [
        law
        for law in sensor_laws([body])
        if law.what == "gyro" and len(law.factors) == 1 and law.factors[0].startswith("gyro")
    ]
    sizes = rng.uniform(-0.02, 0.02, len(mixed))
    (path,) = write_laws(Equation(tuple(mixed), sizes, sizes, 1e3), platform, tmp_path)
    effect = effect_named(str(path)).typical("")
    truth = Samples(output.value[None], output.time[None], np.ones((1, len(output.time)), bool))
    back = effect.undo(effect.apply(truth, platform), platform).value
    # three rounds leave the fourth power of at most 0.06
    np.testing.assert_allclose(back, truth.value, atol=2e-5 * np.abs(truth.value).max())
