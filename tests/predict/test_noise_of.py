"""What a stream says of its noise, and where its platform must say it instead."""

import numpy as np
import pytest

from twin.platform import load_platform
from twin.predict.sensors.outputs import noise_of
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
