"""One simulated machine stands behind several devices, and its masses follow their drives."""

from dataclasses import replace

import numpy as np
import pytest

from twin.emulate.emulated import Fault
from twin.emulate.machine import EmulatedMachine
from twin.emulate.platform import EmulatedPlatform, with_port
from twin.errors import UnknownName, UsageError
from twin.plant.hardware_setup import HardwareSetup, read_hardware
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform


@pytest.fixture
def astros() -> Platform:
    return load_platform("astros")


@pytest.fixture
def setup(astros: Platform) -> HardwareSetup:
    return read_hardware(astros)


def test_masses_on_drives_of_their_own_turn_the_table_as_those_of_the_machines_drives(astros):
    fine = replace(astros, control_rate=1.0 / astros.step)
    planned, driven = SimulatedPlant(fine), SimulatedPlant(fine)
    stages = planned.machine.stage_qpos
    for step in range(400):
        time = step * fine.tick
        planned.read(time)
        driven.drive_stages(planned.state[0][:, stages])
        driven.read(time)
        planned.write({"command_stage_position": np.array([[0.01, -0.005, -0.01]])})
    for one, other in zip(planned.state, driven.state, strict=True):
        np.testing.assert_allclose(other, one, atol=2e-6)
    assert np.abs(planned.state[0][:, stages]).min() > 4e-3, "the masses are there"
    assert np.abs(planned.state[1][:, planned.machine.base_dof]).max() > 1e-3, "it has turned"


def test_each_device_gets_its_own_streams_of_the_one_machine(astros, setup):
    machine = EmulatedMachine(astros, setup.measured, setup.commanded, seed=1).simulated()
    imu, tilt, stages = (machine.share(name) for name in ("imu", "tilt", "stages"))
    seen = imu.step({}, 1.0)
    assert {shown.source for shown in seen} == {"gyro", "accelerometer", "magnetometer"}
    assert [shown.time for shown in seen] == sorted(shown.time for shown in seen)
    assert {shown.source for shown in tilt.step({}, 1.0)} == {"inclinometer"}
    assert {shown.source for shown in stages.step({}, 1.0)} == {"stage_position"}
    assert imu.step({}, 1.0) == [], "nothing comes twice"


def test_a_drive_moves_its_own_column_and_the_others_stand(astros, setup):
    (route,) = setup.commanded
    columns = tuple(reversed(route.columns))
    turned = replace(route, columns=columns, scale=-1.0)
    machine = EmulatedMachine(astros, setup.measured, (turned,)).simulated()
    share = machine.share("stages")
    share.drive = lambda time: np.array([1e-3 * min(time, 1.0), 0.0, 0.0])
    share.step({}, 2.0)
    np.testing.assert_allclose(machine.place, [0.0, 0.0, -1e-3], atol=1e-12)


def test_several_devices_are_each_given_a_port_by_name(setup):
    found = with_port(setup, "imu=/dev/a,tilt=socket://host:1")
    ports = {name: settings.port for name, settings in found.devices.items()}
    assert ports["imu"] == "/dev/a"
    assert ports["tilt"] == "socket://host:1"
    assert ports["stages"] == setup.devices["stages"].port


@pytest.mark.parametrize(
    ("port", "error", "sentence"),
    [
        ("/dev/a", UsageError, "give serial:stages=PORT,tilt=PORT,imu=PORT"),
        ("imu=/dev/a,gyro=/dev/b", UnknownName, "no device named 'gyro'"),
    ],
)
def test_a_port_that_is_nobodys_is_refused(setup, port, error, sentence):
    with pytest.raises(error, match=sentence):
        with_port(setup, port)


def test_what_cannot_be_emulated_is_told_beforehand(astros, setup):
    with pytest.raises(UsageError, match="--lockstep is for one microcontroller"):
        EmulatedPlatform(astros, setup, lockstep=True)
    with pytest.raises(UnknownName, match="no device named 'imo'"):
        EmulatedPlatform(astros, setup, faults=[Fault("unplug", device="imo")])
    with pytest.raises(UsageError, match=r"must give it its stages once"):
        EmulatedPlatform(astros, replace(setup, commanded=()))
    with pytest.raises(UsageError, match="no device"):
        EmulatedPlatform(astros, replace(setup, devices={}))
