"""A law in another program flies the machine as one of ours does, and cannot harm it by failing."""

import re
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.processes import PATIENCE, running
from twin.cli.library import Controllers
from twin.clock import SimulatedClock
from twin.controller import remote
from twin.errors import ControllerError, UsageError
from twin.estimators.estimator import blank
from twin.flight import Flight, prepare
from twin.loop import Ended, Outcome
from twin.metrics import Metrics
from twin.plant.devices.link.near_end import NearEnd
from twin.plant.guard.guarded import Held
from twin.platform import load_platform
from twin.signals import Target
from twin.stream.recorder import MemoryRecorder

Array = NDArray[np.float64]
FIRMWARE = Path(__file__).parents[2] / "docs" / "firmware"
CC = shutil.which("cc")
LEVEL = Target(np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass
class Program:
    """A law in a thread of its own: damps, and at some tick does something else."""

    platform: str = "sads"
    drives: str = "command_wheel_torque"

    valid_for_ms: int = 200
    at: int = -1
    """Tick of its deed."""
    deed: Callable[[NearEnd], bytes] | None = None
    """What it says instead of an answer; b"" for nothing at all."""
    gain: float = 8.0
    width: int = 3
    ticks: int = 0
    heard: dict[str, Array] = field(default_factory=dict)
    """Last value of each channel."""

    def fly(self, told: str) -> None:
        """Connect to where that sentence says that it is waited for."""
        port = int(re.findall(r"tcp://127.0.0.1:(\d+)", told)[0])
        near = NearEnd(remote.schema_of(load_platform(self.platform)), "twin")
        line = socket.create_connection(("127.0.0.1", port))
        threading.Thread(target=self._run, args=(line, near), daemon=True).start()

    def _run(self, line: socket.socket, near: NearEnd) -> None:
        # the twin may close while something of ours is on its way
        with line, suppress(ConnectionResetError):
            line.sendall(near.greet(0.0))
            line.sendall(near.arm(self.valid_for_ms, 0.0))
            rate = np.zeros(3)
            while data := line.recv(4096):
                for sample in near.hear(data, 0.0):
                    self.heard[sample.stream] = np.array(sample.value)
                    if sample.stream == "estimate_rate":
                        rate = np.array(sample.value)
                    elif sample.stream == "reference_rate":
                        said = self._answer(near, rate)
                        if said is None:
                            return
                        line.sendall(said)

    def _answer(self, near: NearEnd, rate: Array) -> bytes | None:
        self.ticks += 1
        if self.ticks == self.at and self.deed is not None:
            return self.deed(near) or None
        return near.setpoints(
            {self.drives: self.gain * np.resize(rate, self.width)}, self.valid_for_ms, 0.0
        )


def flight_of(
    program: Program, duration: float = 5.0, plant: str = "sim", held: Held | None = None
) -> Flight:
    return prepare(
        program.platform,
        controller="tcp://127.0.0.1:0",
        estimator=None,
        plant=plant,
        reference=None,
        duration=duration,
        held=held,
        lockstep=plant == "pty",
        tell=program.fly,
    )


def flown(program: Program, duration: float = 5.0) -> Outcome:
    flight = flight_of(program, duration)
    with flight.plant:
        return flight.fly(SimulatedClock())


def compiled_law(folder: Path, capsys: pytest.CaptureFixture[str]) -> Path:
    assert Controllers(header="sads").run() == 0
    (folder / "channels.h").write_text(capsys.readouterr().out)
    out = folder / "law"
    sources = [str(FIRMWARE / name) for name in ("law.c", "link.c")]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-Wconversion"]
    include = ["-I", str(FIRMWARE), "-I", str(folder)]
    words = [str(CC), *strict, *include, "-o", str(out), *sources, "-lm"]
    subprocess.run(words, check=True, timeout=PATIENCE)
    return out


@pytest.mark.skipif(CC is None, reason="no C compiler `cc` on this machine")
def test_the_law_in_c_flies_as_the_same_law_in_python(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    def rms(controller: str, tell: Callable[[str], None] = print) -> float:
        flight = prepare(
            "sads",
            controller=controller,
            estimator=None,
            plant="sim",
            reference="hold:2,-1,5",
            duration=40.0,
            tell=tell,
        )
        metrics = Metrics(flight.platform)
        with flight.plant:
            assert flight.fly(SimulatedClock(), [metrics]).ended is Ended.done
        return float(metrics.rows()["tracking_error_rms_rad"][0])

    def start(told: str) -> None:
        port = re.findall(r"tcp://127.0.0.1:(\d+)", told)[0]
        processes.append(ended.enter_context(running([law, "127.0.0.1", port])))

    processes: list[subprocess.Popen[bytes]] = []
    law = compiled_law(tmp_path, capsys)
    with ExitStack() as ended:
        outside = rms("tcp://127.0.0.1:0", start)
        assert processes[0].wait() == 0
    # numbers cross as float32
    assert outside == pytest.approx(rms("quaternion_pd"), rel=1e-6)


def test_time_stands_still_until_it_has_answered_so_a_run_repeats():
    def last(program: Program) -> Array:
        flight = flight_of(program, 2.0)
        with flight.plant:
            flight.fly(SimulatedClock())
            return flight.plant.truth()["truth_attitude"].value

    first, second = Program(), Program()
    np.testing.assert_array_equal(last(first), last(second))
    assert first.ticks == second.ticks > 30


DEEDS: dict[str, tuple[Callable[[NearEnd], bytes], str]] = {
    "goes": (lambda near: b"", "is gone"),
    "stops": (lambda near: near.safe_stop(0.0), "asked for a stop"),
    "disarms": (lambda near: near.disarm(0.0), "asked for a stop"),
    "arms for too long": (
        lambda near: near.arm(9000, 0.0),
        "armed with a time-to-live that is not",
    ),
    "greets": (lambda near: near.greet(0.0), "greeted anew"),
}


@pytest.mark.parametrize("deed", DEEDS)
def test_a_law_that_fails_ends_the_run_safely_with_a_sentence(deed: str):
    what, sentence = DEEDS[deed]
    outcome = flown(Program(at=20, deed=what))
    assert outcome.ended is Ended.safe_stop
    assert sentence in outcome.reason
    assert outcome.duration == pytest.approx(20 * 0.05, abs=0.1)


def test_a_law_that_falls_silent_is_not_waited_for_in_vain(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(remote, "ANSWERS", 0.2)
    outcome = flown(Program(at=20, deed=lambda near: b"\0"))
    assert outcome.ended is Ended.safe_stop
    assert "did not answer within 0.2 s" in outcome.reason


def test_a_set_point_that_is_over_before_the_next_tick_ends_the_run():
    outcome = flown(Program(valid_for_ms=20))
    assert outcome.ended is Ended.safe_stop
    assert "let its command_wheel_torque run out" in outcome.reason


def test_a_number_that_is_not_finite_ends_the_run_with_its_channel():
    outcome = flown(Program(gain=np.nan))
    assert outcome.ended is Ended.safe_stop
    assert "set a command_wheel_torque that no board takes: a number that is not" in outcome.reason


def test_beside_the_wall_clock_what_it_said_last_holds_for_as_long_as_it_said():
    platform = load_platform("sads")
    program = Program(at=2, deed=lambda near: b"\0")
    law = remote.RemoteLaw(platform, "tcp://127.0.0.1:0", lockstep=False, tell=program.fly)
    estimate = blank(platform, 1)
    estimate.valid[:] = True
    estimate.rate_body[:] = (0.01, 0.0, -0.02)
    command, state = law.update(law.init(platform, 1), estimate, LEVEL, 0.0)
    told = command["command_wheel_torque"]
    np.testing.assert_allclose(told, 8.0 * estimate.rate_body, rtol=1e-6)
    command, state = law.update(state, estimate, LEVEL, 0.15)
    np.testing.assert_array_equal(command["command_wheel_torque"], told)
    assert law.lost(state) == ""
    command, state = law.update(state, estimate, LEVEL, 0.25)
    assert command == {}
    assert "run out" in law.lost(state)
    law.close()


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_it_flies_a_machine_over_its_line():
    program = Program("cubesat", "command_dipole", valid_for_ms=500, gain=10.0)
    flight = flight_of(program, 1.0, "pty", Held.floating)
    recorder = MemoryRecorder(flight.platform, {})
    with flight.plant:
        # which the bench replaces by its own
        outcome = flight.fly(SimulatedClock(), [recorder])
    assert outcome.ended is Ended.done, outcome.reason
    log = recorder.recording()
    told = log["command_dipole"].value
    rate = log["estimate_rate"].value
    assert np.ptp(told, axis=0).min() > 0.0
    # the answer to one tick is in force in it
    np.testing.assert_allclose(told, program.gain * rate[-len(told) :], rtol=1e-3, atol=1e-6)


def test_nobody_who_comes_is_told_where_he_was_waited_for(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(remote, "COMES", 0.1)
    with pytest.raises(ControllerError, match=r"tcp://127\.0\.0\.1:\d+ has not come"):
        remote.RemoteLaw(load_platform("sads"), "tcp://127.0.0.1:0", lockstep=True, tell=str)


@pytest.mark.skipif(sys.platform != "linux", reason="all of 127/8 is this computer there")
def test_a_stranger_is_sent_away_and_the_one_who_may_come_is_waited_for(monkeypatch):
    monkeypatch.setattr(remote, "COMES", 0.5)
    told: list[str] = []
    lines: list[socket.socket] = []

    def come(sentence: str) -> None:
        told.append(sentence)
        if found := re.findall(r"tcp://127.0.0.1:(\d+)", sentence):
            place = ("127.0.0.1", int(found[0]))
            lines.append(socket.create_connection(place, source_address=("127.0.0.3", 0)))

    with pytest.raises(ControllerError, match="1 from elsewhere were sent away"):
        remote.RemoteLaw(
            load_platform("sads"), "tcp://127.0.0.1:0?from=127.0.0.2", lockstep=True, tell=come
        )
    assert told[-1] == "127.0.0.3 is not 127.0.0.2: sent away"
    assert lines[0].recv(1) == b""
    lines[0].close()


def test_a_law_that_arms_for_longer_than_is_taken_is_told_so(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(remote, "COMES", 2.0)
    fly = Program(valid_for_ms=9000).fly
    with pytest.raises(ControllerError, match="armed with a time-to-live .* 1 to 500 ms"):
        remote.RemoteLaw(load_platform("sads"), "tcp://127.0.0.1:0", lockstep=True, tell=fly)


def test_a_law_made_for_other_channels_is_refused():
    def fly(told: str) -> None:
        port = int(re.findall(r"tcp://127.0.0.1:(\d+)", told)[0])
        line = socket.create_connection(("127.0.0.1", port))
        lines.append(line)
        line.sendall(NearEnd(remote.schema_of(load_platform("sads")), "twin").greet(0.0))

    lines: list[socket.socket] = []
    with pytest.raises(ControllerError, match="speaks of other channels"):
        remote.RemoteLaw(load_platform("cubesat"), "tcp://127.0.0.1:0", lockstep=True, tell=fly)
    lines[0].close()


@pytest.mark.parametrize(
    ("address", "sentence"),
    [
        ("tcp://127.0.0.1", "tcp://HOST:PORT"),
        ("tcp://:5001", "tcp://HOST:PORT"),
        ("tcp://127.0.0.1:70000", "tcp://HOST:PORT"),
        ("udp://127.0.0.1:5001", "tcp://HOST:PORT"),
        ("tcp://192.0.2.1:5001?from=192.0.2.2", "cannot listen"),
        ("tcp://0.0.0.0:5001", "whoever comes first would command the machine"),
        ("tcp://[::]:5001", "whoever comes first would command the machine"),
        ("tcp://127.0.0.1:5001?peer=1", "is tcp://HOST:PORT"),
    ],
)
def test_an_address_that_cannot_be_is_refused(address: str, sentence: str):
    with pytest.raises(UsageError, match=re.escape(sentence)):
        remote.RemoteLaw(load_platform("sads"), address, lockstep=True, tell=str)


def test_its_gains_are_its_own():
    with pytest.raises(UsageError, match="its own"):
        prepare(
            "sads",
            controller="tcp://127.0.0.1:0",
            estimator=None,
            plant="sim",
            reference=None,
            duration=1.0,
            gains={"derivative": 8.0},
        )


def test_a_program_is_told_the_place_of_a_machine_that_travels():
    places = ["estimate_position", "estimate_velocity", "reference_position", "reference_velocity"]
    channels = [
        channel.stream for channel in remote.schema_of(load_platform("astros:mode_c")).channels
    ]
    assert channels[channels.index("reference_attitude") - 4 :][:4] == places
    still = [channel.stream for channel in remote.schema_of(load_platform("astros")).channels]
    assert not set(places) & set(still)
    program = Program("astros:mode_c", "command_thruster", gain=0.0, width=12)
    assert flown(program, 1.0).ended is Ended.done
    heard = program.heard
    np.testing.assert_allclose(heard["estimate_position"][:2], 0.0, atol=5e-3)
    assert np.isnan(heard["reference_position"]).all()
