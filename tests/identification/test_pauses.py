"""Who identifies a log that paused for an hour, or for ten days, loses nothing by it."""

import dataclasses

import numpy as np
import pytest
from scipy.stats import chi2

from tests.seeds import seed_of
from twin.conventions import check_conventions
from twin.identification import identify
from twin.platform import load_platform
from twin.recording import Recording

SADS = load_platform("sads")


def paused(recording: Recording, at: float, pause: float) -> Recording:
    """The clock goes on for so long [s] while nobody records."""
    streams = {
        name: dataclasses.replace(series, time=series.time + pause * (series.time > at))
        for name, series in recording.items()
    }
    return dataclasses.replace(recording, streams=streams)


@pytest.mark.parametrize("pause", [3600.0, 864000.0])
def test_the_base_is_found_in_a_log_that_paused_and_nothing_in_it_looks_misread(
    excited, pause, request: pytest.FixtureRequest
):
    seed = seed_of(request)
    stated = dataclasses.replace(SADS, tilt_limit=np.pi, effects=())
    flown = excited(stated, 1, seed, 36.0)
    whole = flown.logs[0]
    parted = paused(whole, whole["gyro"].time[0] + 19.0, pause)
    assert not check_conventions(parted, stated)
    found = identify([parted], stated)
    assert len(found.recordings) == 2
    error = found.theta[:9] - flown.truth
    distance = float(error @ np.linalg.solve(found.covariance[:9, :9], error))
    assert distance < chi2.ppf(0.999, 9), "found, but not where its intervals say"
    assert (found.half_widths[:9] < 0.1 * found.base.scale[:9]).all(), "its intervals say nothing"
