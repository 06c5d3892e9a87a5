"""What a stream says of its noise, and where its platform must say it instead."""

import numpy as np
import pytest

from twin.platform import load_platform
from twin.predict.sensors import Output, noise_of
from twin.recording import Recording, Series

ASTROS = load_platform("astros")
ROUNDING = ASTROS.sensors["gimbal_angle"].resolution / np.sqrt(12.0)


@pytest.mark.parametrize("flickers", [0, 1, 400], ids=["none", "once", "half of the time"])
def test_a_gimbal_that_stands_still_is_known_no_better_than_its_encoder_counts(flickers):
    time, digit = 0.05 * np.arange(800), ASTROS.sensors["gimbal_angle"].resolution
    value = np.tile(digit * np.array([-61.0, -60.0, 42.0, 44.0]), (800, 1))
    where = np.random.default_rng(20261124).choice(800, flickers, replace=False)
    value[where, 1] += digit
    series = Series(time, value, ("g1", "g2", "g3", "g4"), "rad")
    log = Recording({"gimbal_angle": series}, {})
    assert np.all(noise_of(log, ASTROS, "gimbal_angle") >= 0.999 * ROUNDING)


@pytest.mark.parametrize(("scatter", "found"), [(0.08, 0.08), (0.3, 0.1), (0.01, 0.01)])
def test_noise_that_motion_hid_is_found_in_what_is_left_up_to_what_is_stated(scatter, found):
    draw = np.random.default_rng(20261125)
    time, left = 0.1 * np.arange(900), scatter * draw.standard_normal((900, 1))
    one, none = np.ones(1), np.zeros(900)
    wheel = Output(
        stream="wheel_speed",
        unit="rad/s",
        columns=("w1",),
        noise=0.05 * one,
        stated=False,
        worth=one,
        claimed=0.1 * one,
        bias=0.0 * one,
        delay=0.0,
        time=time,
        value=left,
        segment=none.astype(np.intp),
        place=none,
        slot=none.astype(np.intp)[:, None],
    )
    again = wheel.with_noise_of(left / wheel.noise)
    np.testing.assert_allclose(again.noise, found, rtol=0.15)
