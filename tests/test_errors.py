"""Our errors reach the process that asked for the work, whole."""

import pickle
from pathlib import Path

import pytest

from twin.errors import CampaignError, DeviceError, TwinError, UnknownName


@pytest.mark.parametrize(
    "error",
    [
        CampaignError("out", "is full", "make room", line=3),
        UnknownName("metric", "tilt", ["tilt_rms"]),
        DeviceError("imu", "is silent", "wire it"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_of_another_process_says_the_same_here(error: TwinError):
    there = pickle.loads(pickle.dumps(error))
    assert type(there) is type(error)
    assert str(there) == str(error)
    assert vars(there) == vars(error)
    assert getattr(there, "path", Path("out")) == Path("out")
