"""Every effect says what it is; whatever is wrong with one is said in a sentence."""

import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import FAN
from twin.effects import (
    EffectError,
    catalogue,
    effect_named,
    effects_of,
    parse_effects,
    with_effects,
)
from twin.effects.effect import targets
from twin.errors import PlatformError, UnknownName
from twin.model import compile_model
from twin.platform import load_platform
from twin.signals import STREAMS

MODELS = Path(__file__).parents[2] / "models"
ALL = catalogue()

each = pytest.mark.parametrize("kind", ALL, ids=lambda kind: kind.name)


@each
def test_an_effect_says_what_it_is_and_what_shows_it(kind):
    assert kind.meaning().endswith((".", ":")) or kind.meaning()
    assert kind.observable
    assert kind.streams
    assert set(kind.streams) <= set(STREAMS)
    for known in kind.parameters():
        assert known.unit, known
        assert known.source, known
        assert known.words, known
        entries = known.typical if isinstance(known.typical, tuple) else (known.typical,)
        assert all(known.low <= entry <= known.high for entry in entries), known
    assert any(known.amplitude for known in kind.parameters())


@each
def test_the_class_of_an_effect_is_called_as_the_effect(kind):
    assert kind.__name__ == kind.name.title().replace("_", "")


@each
def test_components_go_in_and_come_out_in_one_order(kind):
    effect = kind.typical()
    values = effect.values * 0.75
    assert len(values) == len(effect.names) == len(kind.scale()) == len(kind.bounds()[0])
    np.testing.assert_array_equal(effect.with_values(values).values, values)
    assert (kind.scale() > 0.0).all()


@each
def test_the_command_line_takes_every_effect_to_the_last_bit(kind):
    effect = kind.typical("wheel_speed" if kind.takes == "stream" else "")
    numbers = "/".join(f"{value:.17g}" for value in effect.values)
    assert parse_effects(f"{effect.label}={numbers}") == (effect,)


WRONG = {
    "gyro_bais=1e-3/0/0": "did you mean 'gyro_bias'",
    "gyro_bias=1e-3": "takes 3 numbers (bias_x [rad/s], bias_y [rad/s], bias_z [rad/s]), not 1",
    "gyro_bias=1e-3/0/0/0": "not 4; separate them by /",
    "gyro_bias=a/0/0": "are no numbers",
    "gyro_bias=nan/0/0": "give a finite number in rad/s",
    "bearing_viscous_friction=-1": "it must lie between 0 and 10 N m s",
    "flexible_appendage=2/0.01/0.1/0/0/0": "give a direction",
    "": "write NAME=VALUE",
    "no/such/file.py=1": "no effect named",
}


@pytest.mark.parametrize("text", WRONG)
def test_a_wrong_effect_is_refused_with_a_sentence(text):
    with pytest.raises((EffectError, UnknownName), match=re.escape(WRONG[text])):
        parse_effects(text)


UNFIT = {
    "clock_lag=0.1": "it needs the stream it acts on, as in clock_lag:gyro",
    "clock_lag:wheels=0.1": "'wheels' is none of its streams",
    "gyro_bias:gyro=0/0/0": "it takes no target",
    "residual_dipole": "has no magnetic field",
    "magnetometer_bias": "the platform has no magnetometer",
    "sensor_lag:attitude=0.1": "use clock_lag:attitude",
    "flexible_appendage=100/0/0.1/0/0/1": "set simulation.step to 0.0005 s or less",
    "liquid_slosh=0.1/0.001/0/0/0/0": "cannot follow a pendulum of 0.001 m",
    "gyro_bias=0/0/0,gyro_bias=0/0/1": "twice; give it once",
}


@pytest.mark.parametrize("text", UNFIT)
def test_an_effect_that_a_platform_cannot_have_is_refused(text):
    with pytest.raises(EffectError, match=re.escape(UNFIT[text])):
        with_effects(load_platform("sads"), parse_effects(text))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    copy = tmp_path / "machine"
    shutil.copytree(MODELS / "sads", copy)
    return copy


def add(folder: Path, text: str) -> int:
    """Append to platform.toml; the line of the first thing added."""
    file = folder / "platform.toml"
    before = file.read_text()
    file.write_text(before + "\n" + text)
    return before.count("\n") + 2


def test_a_platform_states_its_effects(folder):
    add(
        folder,
        "[effects.gyro_bias]\nbias = [1e-3, 0.0, 0.0]\n"
        "[effects.clock_lag.wheel_speed]\nlag = 0.17\n"
        "[effects.clock_lag.gyro]\nlag = 0.01\n"
        '[effects.aerodynamic_drag]\ndrag = 1e-3\nvariant = "norm"\n',
    )
    effects = effects_of(load_platform(folder))
    assert [effect.label for effect in effects] == [
        "gyro_bias",
        "clock_lag:wheel_speed",
        "clock_lag:gyro",
        "aerodynamic_drag",
    ]
    assert effects[1].lag == 0.17
    assert effects[3].variant == "norm"


TOML = {
    "[effects.gyro_bais]\nbias = [0, 0, 0]": "did you mean 'gyro_bias'",
    "[effects.gyro_bias]\nbais = [0, 0, 0]": "did you mean 'bias'",
    "[effects.gyro_bias]\n": "gyro_bias lacks bias [rad/s]; add it",
    "[effects.gyro_bias]\nbias = 1e-3": "bias takes 3 numbers in rad/s, not 0.001",
    '[effects.gyro_bias]\nbias = ["a", 0, 0]': "bias is 'a'; give a finite number in rad/s",
    "[effects.clock_lag.wheels]\nlag = 0.1": "'wheels' is none of its streams",
    "[effects.bearing_viscous_friction]\ndamping = true": "give a finite number in N m s",
    '[effects.aerodynamic_drag]\ndrag = 1.0\nvariant = "x"': "use one of 'axes', 'norm'",
    '[effects."own.py"]\nsize = 1.0': "a platform runs no code of its own",
}


@pytest.mark.parametrize("text", TOML)
def test_a_wrong_effect_of_a_platform_is_refused_with_its_line(folder, text):
    line = add(folder, text)
    with pytest.raises(PlatformError, match=re.escape(TOML[text])) as caught:
        compile_model(load_platform(folder))
    assert caught.value.line == line


def test_a_lab_adds_an_effect_of_its_own_by_its_file(tmp_path, sads):
    file = tmp_path / "fan.py"
    file.write_text(FAN)
    (effect,) = parse_effects(f"{file}=0.5")
    assert effect.words() == "fan: size 0.5 N m"
    machine = compile_model(with_effects(sads, (effect,)))
    assert machine.effects == (effect,)


BROKEN = {
    "raise RuntimeError('x')": "cannot be imported, RuntimeError: x",
    "from twin.effects import Domain": "defines 0 effects (none)",
    FAN.replace("observable", "tells"): "lacks `observable`",
    FAN.replace('parameter("of the fan", "N m", 1e-3, source="measured")', "1.0"): "no parameter",
}


@pytest.mark.parametrize("text", BROKEN)
def test_a_broken_file_is_refused_with_a_sentence(tmp_path, text):
    file = tmp_path / "fan.py"
    file.write_text(text)
    with pytest.raises(EffectError, match=re.escape(BROKEN[text])):
        effect_named(str(file))


@each
def test_an_effect_at_no_amplitude_changes_nothing(kind, sads):
    """A body that it adds may stay in the model of every run of a batch."""
    known = targets(kind.takes, sads)
    effect = kind.typical(known[0] if known else "").absent()
    if effect.unfit(sads):
        pytest.skip(effect.unfit(sads))
    from tests.effects.motion import apart, flown
    from twin.plant.initial import InitialState

    start = InitialState(rate_body=np.array([0.01, -0.02, 0.05]))
    fine = replace(sads, step=1e-3) if kind.name == "wheel_imbalance" else sads
    _, one, _ = flown(fine, (effect,), 2.0, start)
    _, other, _ = flown(fine, (), 2.0, start)
    assert apart(one[-1], other[-1]) < 1e-9
