"""A machine whose board and cameras are in a network, emulated on this computer."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.bench import Bench, captured, carried
from twin.emulate.emulated import Fault
from twin.emulate.platform import EmulatedPlatform
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.rotation import from_rotation_vector, multiply, to_rotation_vector

pytestmark = pytest.mark.wall_clock

TURNED = InitialState(attitude=from_rotation_vector(np.array([0.0, 0.0, 0.4])))


class Patient(EmulatedPlatform):
    """Its guard waits as long as a busy test machine may make a device wait."""

    @property
    def setup(self) -> HardwareSetup:
        found = super().setup
        return replace(found, guard=replace(found.guard, stale_cycles=100, watchdog=np.inf))


def test_the_attitude_that_cameras_send_is_the_machines_and_its_loss_has_a_reason():
    cubesat = load_platform("cubesat")
    setup = read_hardware(cubesat, Path(__file__).with_name("network.toml"))
    lost = Fault("lost", 5.0, value=1000.0, device="cameras")
    emulation = Patient(captured(cubesat), setup, seed=3, initial=TURNED, faults=[lost])
    with Bench(carried(cubesat, setup), setup, emulation=emulation) as bench:
        first = None
        for now in bench.begin().ticks(bench.platform.tick, 60.0):
            seen = bench.read(now).streams.get("attitude")
            if seen is not None and first is None and seen.valid[0].any():
                first = seen.value[0, np.argmax(seen.valid[0])]
            if "do not see table" in bench.hardware.why_bad("attitude"):
                break
        else:
            pytest.fail("nobody said that the body was lost")
    assert first is not None
    off = multiply(first, TURNED.attitude * [1, -1, -1, -1])
    assert np.linalg.norm(to_rotation_vector(off)) < 8e-3, "noise is 1e-3 rad an axis"
