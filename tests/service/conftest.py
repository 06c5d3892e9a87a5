"""Machines on their emulated bench, in lockstep: no test here depends on how busy a computer is."""

from collections.abc import Callable
from dataclasses import replace

import pytest

from twin.bench import Bench, captured
from twin.emulate.platform import EmulatedPlatform
from twin.plant.devices.link import Channel
from twin.plant.devices.microcontroller import MicrocontrollerSettings
from twin.plant.guard.guarded import Held
from twin.plant.guard.rules import guard_settings
from twin.plant.hardware_setup import HardwareSetup, Route, read_hardware
from twin.plant.initial import InitialState
from twin.platform import Platform, load_platform
from twin.signals import stream_named


class Miswired(EmulatedPlatform):
    """Its host believes in other routes than those by which it was wired."""

    def __init__(self, *words, believed: HardwareSetup, **more) -> None:
        super().__init__(*words, **more)
        self._believed = believed

    @property
    def setup(self) -> HardwareSetup:
        routes = {"measured": self._believed.measured, "commanded": self._believed.commanded}
        return replace(super().setup, **routes)


@pytest.fixture
def cubesat() -> Platform:
    return load_platform("cubesat")


@pytest.fixture
def table(cubesat: Platform) -> Callable[..., Bench]:
    """`table(held, ...)`: the emulated CubeSat table, not entered."""

    def made(
        held: Held | None = None,
        *,
        modelled: Platform = cubesat,
        believed: HardwareSetup | None = None,
    ) -> Bench:
        setup = read_hardware(cubesat)
        simulated = captured(cubesat) if held is Held.captured else cubesat
        emulation = Miswired(simulated, setup, believed=believed or setup, seed=1, lockstep=True)
        return Bench(modelled, setup, held=held, emulation=emulation)

    return made


def all_on_one_board(platform: Platform, *streams: str) -> HardwareSetup:
    """A microcontroller that carries these streams and all that the machine takes."""
    channels, measured, commanded = [], [], []
    for stream in (*streams, *platform.commands):
        takes = stream.startswith("command_")
        columns = tuple(range(len(platform.columns(stream))))
        safe = ("hold" if "stage" in stream else "zero") if takes else ""
        unit = stream_named(stream).unit
        channels.append(Channel(stream, unit, len(columns), "float32", 1.0, safe))
        (commanded if takes else measured).append(Route(stream, "board", stream, columns))
    settings = MicrocontrollerSettings(name="board", port="", channels=tuple(channels))
    guard = guard_settings(platform)
    return HardwareSetup({"board": settings}, tuple(measured), tuple(commanded), guard, None)


@pytest.fixture
def dumbbell() -> Callable[..., Bench]:
    """`dumbbell(held, speed, sign)`: KNTU's simulator with spinning wheels, on one board."""

    def made(held: Held | None, speed: float, sign: float = 1.0) -> Bench:
        sads = load_platform("sads")
        setup = all_on_one_board(sads, *sads.sensors)
        believed = replace(
            setup,
            commanded=tuple(
                replace(route, scale=sign) if "wheel" in route.stream else route
                for route in setup.commanded
            ),
        )
        initial = InitialState(wheel_speed=speed)
        simulated = captured(sads) if held is Held.captured else sads
        emulation = Miswired(
            simulated, setup, believed=believed, seed=1, initial=initial, lockstep=True
        )
        return Bench(sads, setup, held=held, emulation=emulation)

    return made
