"""The panel in small: intervals cover, errors keep to the Cramer-Rao bound, nothing is invented."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, chi2, norm

PANEL = Path(__file__).with_name("panel.py")
CHANCE = 1e-4
"""With which an honest fit fails any one of the checks below: less than once in 1000 runs any."""


@pytest.fixture(scope="module", params=["middle", "coarse-unstable"])
def fits(request, tmp_path_factory) -> list[dict]:
    """Ten fits of a grade, none told the noise."""
    folder = tmp_path_factory.mktemp("panel")
    command = [sys.executable, PANEL, folder, "--logs", "10", "--duration", "60"]
    run = subprocess.run(
        [*command, "--only", request.param],
        capture_output=True,
        text=True,
        check=False,
        timeout=3600,
    )
    print(run.stdout, run.stderr)
    assert run.returncode == 0
    return [fit for path in folder.glob("*.json") for fit in json.loads(path.read_text())]


@pytest.mark.slow
def test_every_fit_settles(fits):
    assert len(fits) == 10
    assert all(fit["converged"] for fit in fits)


@pytest.mark.slow
def test_intervals_of_unknown_noise_cover_the_truth(fits):
    error, half = (np.array([fit[key] for fit in fits]) for key in ("error", "half"))
    outside = np.count_nonzero(np.abs(error) > half)
    print(f"{outside} of {error.size} outside")
    assert outside <= most_outside([np.array(fit["covariance"]) for fit in fits])


@pytest.mark.slow
def test_errors_are_as_large_as_their_covariance_says(fits):
    """e^T C^-1 e of normal errors is chi-square."""
    total, freedom = squared_length(fits, "covariance")
    assert chi2.ppf(CHANCE / 2, freedom) < total < chi2.isf(CHANCE / 2, freedom)


@pytest.mark.slow
def test_errors_keep_to_the_cramer_rao_bound(fits):
    total, freedom = squared_length(fits, "least")
    assert chi2.sf(1.3**2 * freedom, freedom) < CHANCE
    assert np.sqrt(total / freedom) < 1.3


@pytest.mark.slow
def test_what_is_left_keeps_its_band(fits):
    """Of bands that hold 95 times in 100."""
    outside = sum(not fit["inside"] for fit in fits)
    assert outside <= binom.isf(CHANCE, len(fits), 0.05)


@pytest.mark.slow
def test_neither_lag_nor_scale_is_invented(fits):
    """Each score is standard normal; how they hang together does not matter to this bound."""
    scores = np.array([fit["scores"] for fit in fits])
    assert np.abs(scores).max() < norm.isf(CHANCE / 2 / scores.size)


def squared_length(fits: list[dict], metric: str) -> tuple[float, int]:
    """Of all errors in the metric of a covariance, and of how many numbers."""
    lengths = [fit["error"] @ np.linalg.solve(np.array(fit[metric]), fit["error"]) for fit in fits]
    print(f"rms {np.sqrt(np.sum(lengths) / (9 * len(fits))):.3f} of {metric}")
    return float(np.sum(lengths)), 9 * len(fits)


def most_outside(covariances: list[np.ndarray], draws: int = 200_000) -> float:
    """Of their 95 % intervals: errors of one fit hang together, so no binomial law holds."""
    rng, count = np.random.default_rng(0), np.zeros(draws)
    for covariance in covariances:
        sigma = np.sqrt(np.diag(covariance))
        lower = np.linalg.cholesky(covariance / np.outer(sigma, sigma))
        normal = rng.standard_normal((draws, len(sigma))) @ lower.T
        count += np.count_nonzero(np.abs(normal) > norm.ppf(0.975), axis=1)
    return float(np.quantile(count, 1.0 - CHANCE))
