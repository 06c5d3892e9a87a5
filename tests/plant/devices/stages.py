"""Emulated MDrive stages, and what a test asks of their samples."""

import numpy as np

from twin.emulate.mdrive import Axis, EmulatedDrive, EmulatedMDrives
from twin.plant.devices.mdrive import HOMED
from twin.plant.devices.mdrive_line import DriveSettings

COMMAND = "command_stage_position"
BAUD = 38400
STEP = 2.54e-3 / 51_200


def drives(names="1", *, homed=True, axis=None, saved=None, **settings) -> EmulatedMDrives:
    """Emulated drives; homed ones have been so by a session before."""
    mark = {"R1": HOMED} if homed else {}
    return EmulatedMDrives(
        drives=[
            EmulatedDrive(name=name, baud=BAUD, axis=axis or Axis(), **settings,
                          saved={"PY": 1, **mark, **(saved or {})})
            for name in names
        ]
    )  # fmt: skip


def stage(address="1", **settings) -> DriveSettings:
    return DriveSettings(
        address=address,
        part=f"s{address}",
        **{"travel": (-0.025, 0.025), "speed": 0.025, **settings},
    )


def go(session, *positions):
    return session.write({COMMAND: np.array(positions, dtype=float)})[COMMAND]


def there(position, part="s1"):
    return lambda got: any(
        s.valid and s.part == part and abs(s.value[0] - position) < STEP for s in got
    )


def valid(samples):
    return [each for each in samples if each.valid]
