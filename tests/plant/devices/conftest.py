"""Emulated devices on ptys, each in a process of its own, and sessions that talk to them."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.plant.devices.stages import BAUD, drives, stage
from twin.emulate.emulated import EmulatedDevice, Fault
from twin.emulate.line import EmulatedLine
from twin.plant.devices.device import Device, DeviceSettings, Sample
from twin.plant.devices.mdrive import MDrive, MDriveSettings
from twin.plant.devices.mdrive_line import DriveSettings
from twin.plant.plausibility import SampleChecks

Plug = Callable[..., EmulatedLine]
WaitFor = Callable[..., list[Sample]]

LONGEST = 30.0
"""For anything that a session should see [s]."""


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Plug]:
    """Puts an emulated device on a line; `plug(device, faults...)`."""
    with ExitStack() as lines:

        def start(device: EmulatedDevice, *faults: Fault, seed: int = 0) -> EmulatedLine:
            line = EmulatedLine(device, tmp_path / "port", faults, seed=seed)
            return lines.enter_context(line)

        yield start


@pytest.fixture
def wait_for() -> WaitFor:
    """What a session gives until something is so, judged as for the loop; fails when a busy
    computer had time for it."""

    checks: dict[Device, SampleChecks] = {}

    def waited(device: Device, wanted: Callable[[list[Sample]], bool]) -> list[Sample]:
        samples: list[Sample] = []
        end = time.monotonic() + LONGEST
        settings = getattr(device, "_settings", None)
        if device not in checks:
            limits = settings.limits() if isinstance(settings, DeviceSettings) else {}
            checks[device] = SampleChecks(device.name, limits)
        while time.monotonic() < end:
            samples += [checks[device].judged(sample) for sample in device.read()]
            if wanted(samples):
                return samples
            time.sleep(0.005)
        pytest.fail(f"not within {LONGEST} s; last: {samples[-3:]}, notes {list(device.notes)}")

    return waited


@pytest.fixture
def reasons() -> Callable[[Sequence[Sample]], str]:
    """All reasons given, in one text."""

    def given(samples: Sequence[Sample]) -> str:
        return " | ".join(dict.fromkeys(each.reason for each in samples if not each.valid))

    return given


@pytest.fixture
def mdrive(tmp_path):
    """A session, closed in the end."""
    opened = []

    def build(*stages: DriveSettings, **settings) -> MDrive:
        settings = {"baud": BAUD, "drives": stages or (stage(),), **settings}
        port = str(tmp_path / "port")
        opened.append(MDriveSettings(name="stages", port=port, **settings).session())
        return opened[-1]

    yield build
    for session in opened:
        session.close()


@pytest.fixture
def armed(plug, mdrive):
    """Line and session that takes commands."""

    def build(device=None, *stages, **settings):
        line = plug(device or drives())
        session = mdrive(*stages, **settings)
        session.configure()
        session.arm()
        return line, session

    return build
