"""Where a misfit sits in one stream or one clock, no half width is called a 95 % interval."""

import secrets
from dataclasses import replace

import numpy as np
import pytest

from tests.identification.conftest import fly_campaign
from twin import rotation
from twin.identification import identify
from twin.recording import Recording, Series
from twin.report import compared, identified

SEED = secrets.randbits(16)


def drifting(log: Recording, draw: np.random.Generator) -> Series:
    """A gyro whose bias goes to and fro within seconds, by three times its noise."""
    gyro = log["gyro"]
    axis = np.eye(3)[draw.integers(3)]
    wave = 3e-3 * np.sin(2.0 * np.pi * gyro.time / draw.uniform(5.0, 9.0))
    return replace(gyro, value=gyro.value + wave[:, None] * axis)


def moved(log: Recording, draw: np.random.Generator) -> Series:
    """An attitude whose camera was knocked by a degree, halfway through."""
    attitude = log["attitude"]
    turn = rotation.from_euler_zyx(0.0, 0.0, np.radians(draw.choice([-1.0, 1.0])))
    after = attitude.time > 0.5 * attitude.time[-1]
    value = attitude.value.copy()
    value[after] = rotation.multiply(np.broadcast_to(turn, value[after].shape), value[after])
    return replace(attitude, value=value)


def late(log: Recording, draw: np.random.Generator) -> Series:
    """Wheel speeds whose stamps are late by some tenths of a second."""
    wheels = log["wheel_speed"]
    return replace(wheels, time=wheels.time + draw.uniform(0.25, 0.35))


FAULTS = {"gyro": drifting, "attitude": moved, "wheel_speed": late}


@pytest.mark.slow
@pytest.mark.parametrize("fault", ["", *FAULTS])
def test_a_misfit_of_one_stream_or_clock_takes_the_intervals_back(fault: str):
    print("seed", SEED)
    campaign = fly_campaign(1, SEED, 20.0)
    log = campaign.logs[0]
    if fault:
        made = FAULTS[fault](log, np.random.default_rng(SEED))
        log = replace(log, streams={**log.streams, fault: made})
    found = identify([log], campaign.stated)
    text = "\n".join(identified(found))
    table = "\n".join(compared({"prediction-error": found}))
    document = found.document()
    if not fault:
        assert found.doubt == ""
        assert "with 95 % intervals:" in text
        assert document["intervals_hold"] is True
        return
    assert found.doubt
    assert "not with 95 % intervals" in text
    assert "intervals that do not hold" in table
    assert document["intervals_hold"] is False
    assert document["doubt"] == found.doubt
