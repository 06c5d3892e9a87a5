"""Sessions with makers' devices under random faults, on the wall's clock at their lines' rates.

Each is opened, configured and armed in good order; then faults of line and device come at random
times, and what falls is connected anew, as an operator would.
"""

import math
import re
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple
from unittest.mock import patch

import numpy as np

from twin.emulate.emulated import LINE_FAULTS, EmulatedDevice, schedule
from twin.emulate.line import EmulatedLine
from twin.emulate.mdrive import EmulatedDrive, EmulatedMDrives
from twin.emulate.mti import EmulatedMti
from twin.emulate.solar2 import EmulatedSolar2
from twin.errors import DeviceError
from twin.plant.devices.device import Device, DeviceSettings, Sample
from twin.plant.devices.mdrive import HOMED, MDrive, MDriveSettings
from twin.plant.devices.mdrive_line import DriveSettings
from twin.plant.devices.mti import MtiSettings
from twin.plant.devices.port import Port
from twin.plant.devices.solar2 import Solar2Settings
from twin.plant.plausibility import SampleChecks

SPAN = 4.0
"""Of one session [s]."""

COMMAND, FAR = "command_stage_position", 0.003
"""Where the stage goes and comes back from [m]."""

STAGE = DriveSettings(address="1", part="s1", travel=(-0.025, 0.025), speed=0.025)

OWN = {
    "imu": ("bad_checksum", "truncated", "drop_packets", "duplicate_packets", "time_wrap",
            "time_step_back", "inner_preamble", "error", "restart", "not_a_number", "saturated",
            "frozen", "well"),
    "tilt": ("short_reply", "text", "binary", "nmea", "stale", "saturated", "well"),
    "stages": ("lost_reply", "double_reply", "garbled_reply", "late_reply", "extra_newline",
               "1:error", "reboot", "stall", "newline_only", "completion", "not_acknowledged"),
}  # fmt: skip
"""Faults of the devices themselves."""

PASSED = {"imu": 256, "tilt": 1, "stages": 128}
"""One damaged message in so many passes the protocol's check; a SOLAR-2 has none."""


class Subject(NamedTuple):
    """One device and its session."""

    device: EmulatedDevice
    settings: DeviceSettings
    wrong: Callable[[Sample], bool]
    """Whether a valid sample is nothing that the device has measured."""


def imu(port: str) -> Subject:
    """An MTi at rest."""
    steps = {"gyro": 0.01, "accelerometer": 0.1}
    truth = {"gyro": (0.01, -0.02, 0.03), "accelerometer": (0.0, 0.0, 9.81)}

    def wrong(sample: Sample) -> bool:
        return max(abs(np.subtract(sample.value, truth[sample.stream]))) > 0.12

    return Subject(EmulatedMti(), MtiSettings(name="imu", port=port, largest_steps=steps), wrong)


def tilt(port: str) -> Subject:
    """A SOLAR-2 on a table that leans."""

    def wrong(sample: Sample) -> bool:
        return max(abs(np.subtract(sample.value, np.radians([1.5, -2.25])))) > math.radians(0.25)

    return Subject(EmulatedSolar2(), Solar2Settings(name="tilt", port=port), wrong)


def stages(port: str) -> Subject:
    """An MDrive that goes to and fro."""
    drive = EmulatedDrive(baud=38400, saved={"PY": 1, "R1": HOMED})
    settings = MDriveSettings(name="stages", port=port, baud=38400, drives=(STAGE,))

    def wrong(sample: Sample) -> bool:
        return not -1e-6 <= sample.value[0] <= FAR + 1e-6

    return Subject(EmulatedMDrives(drives=[drive]), settings, wrong)


SUBJECTS = {"imu": imu, "tilt": tilt, "stages": stages}


def session(name: str, seed: int) -> dict[str, Any]:
    """Fly one; how it ended, and what must never be (`problems`, empty)."""
    kinds = {*LINE_FAULTS, *OWN[name]}
    if name == "stages":
        kinds -= {"power_cycle"}  # which loses the position: its own test
    faults = schedule(seed, kinds, span=SPAN, mean_gap=0.4, duration=0.2, share=0.01)
    said: list[bytes] = []
    write = Port.write

    def noted(port: Port, data: bytes) -> None:
        said.append(data)
        write(port, data)

    with tempfile.TemporaryDirectory() as folder, patch.object(Port, "write", noted):
        port = Path(folder) / "port"
        subject = SUBJECTS[name](str(port))
        with EmulatedLine(subject.device, port, seed=seed) as line:
            device = subject.settings.session()
            device.configure()
            device.arm()
            for fault in faults:
                line.inject(fault)
            checks = SampleChecks(name, subject.settings.limits())
            samples, fallen = _flown(device, checks)
            device.close()
        reasons = [item.replace(str(port), "its port") for item in fallen if item]
    false = [sample for sample in samples if sample.valid and subject.wrong(sample)]
    problems = [f"no reason in {reason!r}" for reason in reasons if ";" not in reason]
    silent = [sample for sample in samples if not sample.valid and not sample.reason]
    problems += [f"{sample.stream} not valid, and no reason" for sample in silent]
    problems += [] if samples else ["nothing was heard"]
    problems += _outside(b"".join(said)) if name == "stages" else []
    counters = device.counters
    damaged = counters.bad_checksums + counters.resyncs
    # sentences that differ in a number say the same
    invalid = list(
        {
            re.sub(r"\d+", "N", sample.reason): sample.reason
            for sample in samples
            if not sample.valid
        }.values()
    )
    ended = "safe_stop" if reasons else "degraded" if invalid or damaged else "continued"
    return {
        "machine": name,
        "seed": seed,
        "faults": [f"{item.kind} {item.start:.2f}" for item in faults],
        "ended": ended,
        "reason": "; ".join(dict.fromkeys(reasons or invalid))[:300] or counters.words(),
        "damaged": damaged,
        "undetected": len(false),
        "problems": problems,
    }


def _flown(device: Device, checks: SampleChecks) -> tuple[list[Sample], list[str]]:
    """What the session gives, judged as for the loop, and the sentences with which it fell."""
    samples: list[Sample] = []
    fallen: list[str] = []
    end = time.monotonic() + SPAN
    while time.monotonic() < end:
        try:
            if device.fault or (isinstance(device, MDrive) and not device.armed):
                fallen.append(device.fault)
                device.configure()
                device.arm()
            if isinstance(device, MDrive):
                device.write({COMMAND: np.array([FAR if len(samples) % 80 < 40 else 0.0])})
        except DeviceError as error:
            fallen.append(str(error))
            time.sleep(0.1)
        samples += [checks.judged(sample) for sample in device.read()]
        time.sleep(0.01)
    return samples, fallen


def _outside(said: bytes) -> list[str]:
    """Commands that left for a stage beyond what it may be told."""
    most = STAGE.steps(FAR) + 1
    result = [
        f"MA {target.decode()}"
        for target in re.findall(rb"MA ?=?(-?\d+)", said)
        if not -1 <= int(target) <= most
    ]
    result += [f"SL {speed.decode()}" for speed in re.findall(rb"SL ?=?(-?[1-9]\d*)", said)]
    return result + ["MR"] * said.count(b"MR ")
