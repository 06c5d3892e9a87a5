"""White noise is as large as the best fit leaves it, wherever the fit before that stands."""

import numpy as np

from twin.contrast import moved
from twin.diagnosis.baseline import baseline_of
from twin.identification.noise_processes import likely_noise
from twin.platform import load_platform


def test_a_base_fitted_under_other_noise_makes_no_sensor_noisier():
    pendulum = load_platform("dfki_pendulum")
    plain = baseline_of([moved(pendulum, (), 10.0, seed=5)], pendulum)
    sigmas = np.sqrt(np.diag(plain.prediction.covariance))
    away = 30.0 * sigmas * (np.arange(len(sigmas)) == 0)
    there = plain.problem.innovations(plain.prediction.moved(away))
    assert there.chi2 > 1.1 * plain.prediction.chi2
    assert not likely_noise(plain.problem, there).scales
