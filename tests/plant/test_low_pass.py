"""A sensor's filter is the analogue one, however finely the physics is stepped."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import butter, lsim

from twin.plant.sensors import LowPass
from twin.platform import load_platform


@pytest.mark.parametrize("step", [0.01, 0.005, 0.002])
@pytest.mark.parametrize(("cutoff", "order"), [(10.0, 4), (2.0, 2)])
def test_what_passes_is_what_the_analogue_filter_passes(step, cutoff, order):
    sensor = replace(load_platform("astros").sensors["gyro"], cutoff=cutoff, order=order)
    time = step * np.arange(round(3.0 / step))
    truth = 0.3 + 0.1 * np.sin(2.0 * np.pi * 0.7 * time) - 0.05 * np.sin(2.0 * np.pi * 2.3 * time)
    passed = LowPass(sensor, step)(truth[None, :, None])[0, :, 0]
    analogue = butter(order, 2.0 * np.pi * cutoff, analog=True)
    fine = np.linspace(0.0, time[-1], 20 * (len(time) - 1) + 1)
    exact = lsim(analogue, np.interp(fine, time, truth) - truth[0], fine)[1][::20] + truth[0]
    assert passed == pytest.approx(exact, abs=1e-6)
