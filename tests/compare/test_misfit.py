"""What a residual is told by."""

import numpy as np
from scipy.signal import lfilter

from twin.compare.misfit import autocorrelation, whiteness

SEED = 20261123


def test_short_logs_of_white_noise_are_called_coloured_as_seldom_as_is_said():
    rng = np.random.default_rng(SEED)
    for count in (60, 120, 600):
        noise = rng.standard_normal((4000, count))
        chances = np.array([whiteness(autocorrelation(one), count) for one in noise])
        for level in (0.01, 0.001):
            seen = int(np.sum(chances < level))
            print(f"{count} samples: {seen} of {len(noise)} below {level}")
            most = len(noise) * level
            assert seen <= most + 4.0 * np.sqrt(most)


def test_a_slow_wobble_of_half_the_noise_is_called_coloured():
    rng = np.random.default_rng(SEED)
    noise = rng.standard_normal((2, 2000))
    wobble = lfilter([np.sqrt(1.0 - 0.95**2)], [1.0, -0.95], noise[0])
    assert whiteness(autocorrelation(noise[1] + 0.5 * wobble), 2000) < 1e-4
