"""Sessions under random faults: no wrong value is ever valid, and each ends with a reason."""

import math
import time

import numpy as np
import pytest

from twin.emulate.faults import LINE_FAULTS, schedule
from twin.emulate.mdrive import EmulatedDrive
from twin.emulate.mdrive_line import EmulatedMDrives
from twin.emulate.mti import EmulatedMti
from twin.emulate.solar2 import EmulatedSolar2
from twin.errors import DeviceError
from twin.plant.devices.mdrive.mdrive import MDriveSettings
from twin.plant.devices.mdrive.settings import DriveSettings
from twin.plant.devices.mdrive.setup import HOMED
from twin.plant.devices.solar2.solar2 import Solar2Settings
from twin.plant.devices.xbus.mti import MtiSettings

SPAN = 4.0
"""Of one session [s]."""
COMMAND = "command_stage_position"
OWN = {
    "imu": ("bad_checksum", "truncated", "drop_packets", "duplicate_packets", "time_wrap",
            "restart", "not_a_number", "saturated", "frozen", "well"),
    "tilt": ("short_reply", "text", "binary", "nmea", "stale", "saturated", "well"),
    "stages": ("lost_reply", "double_reply", "garbled_reply", "late_reply", "extra_newline",
               "1:error", "reboot", "stall", "newline_only", "completion", "not_acknowledged"),
}  # fmt: skip
"""Faults of the devices themselves."""


def imu(port):
    device = EmulatedMti()
    settings = MtiSettings(
        name="imu", port=port, largest_steps={"gyro": 0.01, "accelerometer": 0.1}
    )
    truth = {"gyro": (0.01, -0.02, 0.03), "accelerometer": (0.0, 0.0, 9.81)}

    def wrong(sample):
        return max(abs(np.subtract(sample.value, truth[sample.stream]))) > 0.12

    return device, settings, wrong


def tilt(port):
    def wrong(sample):
        return max(abs(np.subtract(sample.value, np.radians([1.5, -2.25])))) > math.radians(0.25)

    return EmulatedSolar2(), Solar2Settings(name="tilt", port=port), wrong


def stages(port):
    drive = EmulatedDrive(baud=38400, saved={"PY": 1, "R1": HOMED})
    stage = DriveSettings(address="1", part="s1", travel=(-0.025, 0.025), speed=0.025)
    settings = MDriveSettings(name="stages", port=port, baud=38400, drives=(stage,))

    def wrong(sample):
        return not -1e-6 <= sample.value[0] <= 0.003 + 1e-6

    return EmulatedMDrives(drives=[drive]), settings, wrong


def fly(session, move):
    """What the session gives; after a fault it is connected anew, as an operator would."""
    samples, fallen = [], []
    end = time.monotonic() + SPAN
    while time.monotonic() < end:
        try:
            if session.fault or move and not session.armed:
                fallen.append(session.fault)
                session.configure()
                session.arm()
            if move:
                session.write({COMMAND: np.array([0.003 if len(samples) % 80 < 40 else 0.0])})
        except DeviceError as error:
            fallen.append(str(error))
            time.sleep(0.1)
        samples += session.read()
        time.sleep(0.01)
    return samples, fallen


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("machine", [imu, tilt, stages], ids=lambda machine: machine.__name__)
def test_random_faults_give_reasons_and_no_wrong_value(plug, tmp_path, machine, seed):
    device, settings, wrong = machine(str(tmp_path / "port"))
    kinds = {*LINE_FAULTS, *OWN[settings.name]}
    if machine is stages:
        kinds -= {"power_cycle"}  # which loses the position: its own test
    faults = schedule(seed, kinds, span=SPAN, mean_gap=0.4, duration=0.2, share=0.01)
    line = plug(device)
    session = settings.session()
    session.configure()
    session.arm()
    for fault in faults:
        line.inject(fault)
    started = time.monotonic()
    samples, fallen = fly(session, machine is stages)
    session.close()
    assert time.monotonic() - started < SPAN + 12.0, "it hung"
    assert samples
    bad = [each for each in samples if each.valid and wrong(each)]
    assert not bad, f"wrong and valid under {faults}"
    assert all(each.reason for each in samples if not each.valid)
    assert all(";" in reason for reason in fallen if reason), "a reason says what would do"
