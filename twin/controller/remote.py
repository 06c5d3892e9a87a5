"""A control law in another program (Simulink, C, flight software), over TCP.

The twin stands for the machine: it is the far end of our own link (docs/link.md). Each tick it
sends what the estimator says and where the body should point, as samples; the program answers
with set-points, as it would answer a board. Their time-to-live counts in the loop's own time.
"""

import contextlib
import select
import socket
import time
from collections.abc import Callable
from ipaddress import ip_address
from urllib.parse import parse_qs, urlsplit

import numpy as np
from numpy.typing import NDArray

from twin.controller.controller import Controller
from twin.errors import ControllerError, UsageError
from twin.plant.devices.link import Channel, FarEndState, Schema, sentence_of
from twin.plant.devices.link.far_end import ALL_CHANNELS, FarEnd
from twin.platform import Platform
from twin.signals import STREAMS, Command, Estimate, Target
from twin.stop import LOOK, check, until

Array = NDArray[np.float64]

SCHEME = "tcp://"

LONGEST_VALID_MS = 500
"""For which a set-point is taken."""

COMES = 60.0
"""A program has so long to connect, greet and arm [s]."""

ANSWERS = 10.0
"""And so long for each answer where time is simulated [s]: it may be stepped by hand."""

QUIET = 0.02
"""Set-points that come together follow each other closer than this [s]."""

_TOLD = 5
"""Strangers that are told of."""

_BAD_ARMING = f"armed with a time-to-live that is not within 1 to {LONGEST_VALID_MS} ms"
_HALF = 2**15
_FULL = 2**16


class RemoteLaw(Controller[str]):
    """The law at the other end of a connection, for one run.

    The state is why it cannot go on, a sentence; empty while it can.
    """

    def __init__(
        self, platform: Platform, address: str, *, lockstep: bool, tell: Callable[[str], None]
    ) -> None:
        """Listen there until a program has connected, greeted and armed.

        Args:
            platform: whose channels it gets.
            address: `tcp://HOST:PORT`; port 0: one that is free. Where HOST is not this computer
                alone, `tcp://HOST:PORT?from=ADDRESS`: no other is let in.
            lockstep: time is simulated, and stands still until the law has answered. Otherwise it
                has half a tick; what it said last stays in force for as long as it said.
            tell: takes a sentence that says where it is waited for, and with which channels.

        Raises:
            UsageError: no such address, or it cannot be listened at.
            ControllerError: nobody came, or whoever came speaks of other channels.
            Stopped: a stop was requested meanwhile.
        """
        self.schema = schema_of(platform)
        self._lockstep = lockstep
        self._patience = ANSWERS if lockstep else 0.5 * platform.tick
        self._complete = False
        self._far = FarEnd(self.schema, platform.name, LONGEST_VALID_MS, 0)
        server, peer = _listening(address)
        with server:
            host, port = server.getsockname()[:2]
            self._name = f"the law at {SCHEME}{host}:{port}"
            tell(f"waiting for {self._name}\n{_listed(self.schema)}")
            self._line = self._await_peer(server, peer, tell)
        self._line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._await_arming()
        except BaseException:
            self._line.close()
            raise

    def init(self, platform: Platform, n: int) -> str:
        """Nothing is lost yet."""
        if n != 1:
            raise ControllerError(f"{self._name} flies one run at a time, not {n}")
        return ""

    def update(
        self, state: str, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, str]:
        """Ask, and what is in force then; nobody is asked before the machine has been seen."""
        device_us = round(time * 1e6)
        if state or not estimate.valid.all():
            return {}, state
        self._far.advance(device_us)
        values = _values(estimate, target)
        for number, channel in enumerate(self.schema.channels):
            if not channel.commanded:
                self._far.sample(number, device_us, values[channel.stream], device_us)
        try:
            state = self._ask(device_us)
        except OSError:
            state = f"{self._name} is gone"
        in_force = {} if state else self._far.setpoint
        return {
            self.schema.channels[number].stream: value[None] for number, value in in_force.items()
        }, state

    def first_command(self, platform: Platform, estimate: Estimate, target: Target) -> Command:
        """It may command whatever the machine has; it is not asked."""
        return {name: np.zeros((1, width)) for name, width in platform.commands.items()}

    def lost(self, state: str) -> str:
        """Its connection, its time-to-live, or its patience."""
        return state

    def close(self) -> None:
        """Tell it that the run is over."""
        self._far.event("SAFE", 0.0, 0)
        with contextlib.suppress(OSError):
            self._line.sendall(self._far.take())
        self._line.close()

    def _ask(self, time_us: int) -> str:
        """Send what waits, and hear until it has answered; why it cannot go on, or nothing."""
        asked = self._far.last_sequence
        self._line.sendall(self._far.take())
        end = time.monotonic() + self._patience
        while self._far.state is FarEndState.armed and not (
            self._answered(asked) or self._refused()
        ):
            if not self._hear(time_us, end - time.monotonic()):
                if self._lockstep:
                    return f"{self._name} did not answer within {self._patience:g} s"
                break
        if self._lockstep and not self._complete:
            # which channels it commands, its first answer tells
            while self._hear(time_us, QUIET):
                pass
            self._complete = True
        return self._refused() if self._far.state is FarEndState.armed else self._why_safe()

    def _refused(self) -> str:
        """What is wrong with a set-point or an ARM that it sent, or nothing."""
        event = self._far.last_event
        if event is None or event.code != "VALUE":
            return ""
        if event.value == ALL_CHANNELS:
            return f"{self._name} {_BAD_ARMING}"
        stream = self.schema.channels[round(event.value)].stream
        return (
            f"{self._name} set a {stream} that no board takes: a number that is not finite, or a "
            f"time-to-live that is not within 1 to {LONGEST_VALID_MS} ms"
        )

    def _answered(self, sequence: int) -> bool:
        """Every channel in force was set anew by somebody who had heard that frame."""
        heard = self._far.heard.values()
        return bool(heard) and all((item - sequence) % _FULL < _HALF for item in heard)

    def _hear(self, time_us: int, patience: float) -> bool:
        """Take what comes, and reply; False: nothing came in time.

        Raises:
            OSError: the connection is closed.
        """
        self._line.settimeout(max(patience, 1e-4))
        try:
            data = self._line.recv(65536)
        except TimeoutError:
            return False
        if not data:
            raise ConnectionError
        self._far.receive(data, time_us)
        self._line.sendall(self._far.take())
        return True

    def _await_peer(
        self, server: socket.socket, peer: str, tell: Callable[[str], None]
    ) -> socket.socket:
        """The connection of the program that may come; strangers are sent away, and told.

        Args:
            server: which listens.
            peer: address that it comes from; empty: any that can reach this one.
            tell: takes a sentence for each stranger.
        """
        end, strangers = time.monotonic() + COMES, 0
        while until(lambda: _readable(server), max(end - time.monotonic(), 0.0)):
            line, (came, *_) = server.accept()
            if not peer or came == peer:
                return line
            line.close()
            strangers += 1
            if strangers <= _TOLD:
                tell(f"{came} is not {peer}: sent away")
        also = f"; {strangers} from elsewhere were sent away" if strangers else ""
        raise ControllerError(
            f"{self._name} has not come within {COMES:g} s{also}; start it, or say where it is "
            "expected"
        )

    def _await_arming(self) -> None:
        end = time.monotonic() + COMES
        problem = f"has not greeted and armed within {COMES:g} s"
        try:
            self._line.sendall(self._far.take())
            while self._far.state is not FarEndState.armed:
                check()
                if not self._hear(0, LOOK):
                    if time.monotonic() > end:
                        break
                    continue
                event = self._far.last_event
                if event is not None and event.code in ("SCHEMA", "VALUE"):
                    other = "speaks of other channels"
                    problem = other if event.code == "SCHEMA" else _BAD_ARMING
                    break
        except OSError:
            problem = "went before it had greeted and armed"
        if self._far.state is not FarEndState.armed:
            raise ControllerError(
                f"{self._name} {problem}: it says HELLO, then ARM, both with the schema hash "
                f"0x{self.schema.hash:08X} of these channels (docs/link.md)"
            )

    def _why_safe(self) -> str:
        event = self._far.last_event
        if event is None or event.code not in ("EXPIRED", "SAFE"):
            return f"{self._name} greeted anew in the middle of the run"
        if event.code == "SAFE":
            return f"{self._name} asked for a stop"
        if event.value == ALL_CHANNELS:
            return f"{self._name} armed, and said nothing"
        stream = self.schema.channels[round(event.value)].stream
        return f"{self._name} let its {stream} run out: {sentence_of('EXPIRED', event.value)}"


_PLACE = ("estimate_position", "estimate_velocity", "reference_position", "reference_velocity")
"""Of a machine that travels; not a number where it is not seen yet, or no place is asked for."""


def schema_of(platform: Platform) -> Schema:
    """The channels that a law outside of this process sees and sets."""
    widths = {
        "estimate_attitude": 4,
        "estimate_rate": 3,
        "wheel_speed": len(platform.wheels),
        "gimbal_angle": len(platform.gimbals),
        "stage_position": len(platform.stages),
        "joint_angle": int(platform.base.kind == "hinge"),
        "joint_rate": int(platform.base.kind == "hinge"),
    }
    if platform.base.travels and "position" in platform.sensors:
        widths |= dict.fromkeys(_PLACE, 3)
    widths |= {"reference_attitude": 4, "reference_rate": 3}
    measured = (Channel(name, STREAMS[name].unit, width) for name, width in widths.items() if width)
    commanded = (
        Channel(
            name,
            STREAMS[name].unit,
            width,
            safe="hold" if name == "command_stage_position" else "zero",
        )
        for name, width in platform.commands.items()
    )
    return Schema((*measured, *commanded))


def _values(estimate: Estimate, target: Target) -> dict[str, Array]:
    return {
        "estimate_attitude": estimate.attitude[0],
        "estimate_rate": estimate.rate_body[0],
        "wheel_speed": estimate.wheel_speed[0],
        "gimbal_angle": estimate.gimbal_angle.reshape(-1),
        "stage_position": estimate.stage_position[0],
        "joint_angle": estimate.joint_angle[0],
        "joint_rate": estimate.joint_rate[0],
        "reference_attitude": np.atleast_2d(target.attitude)[0],
        "reference_rate": np.atleast_2d(target.rate_body)[0],
    } | {
        name: np.full(3, np.nan) if place is None else np.atleast_2d(place)[0]
        for name, place in zip(
            _PLACE,
            (estimate.position, estimate.velocity, target.position, target.velocity),
            strict=True,
        )
    }


def _listed(schema: Schema) -> str:
    rows = [
        f"  channel {number}: {channel.stream}, {channel.columns} [{channel.unit}]"
        for number, channel in enumerate(schema.channels)
    ]
    return "\n".join([*rows, f"  schema hash 0x{schema.hash:08X}"])


def _listening(address: str) -> tuple[socket.socket, str]:
    """What listens there, and the only address that may come; empty: any of this computer."""
    try:
        parts = urlsplit(address)
        host, port = parts.hostname, parts.port
        options = parse_qs(parts.query, strict_parsing=bool(parts.query))
    except ValueError:
        host = port = None
        options = {}
    if not address.startswith(SCHEME) or not host or port is None or options.keys() - {"from"}:
        raise UsageError(
            f"controller {address!r}: a law in another program is {SCHEME}HOST:PORT, as in "
            f"{SCHEME}127.0.0.1:5001"
        )
    peer = options.get("from", [""])[0]
    if not peer and not _is_loopback(host):
        raise UsageError(
            f"controller {address!r}: whoever comes first would command the machine, from anywhere "
            f"that reaches {host}; say who may, as in {SCHEME}{host}:{port}?from=192.168.1.20, or "
            f"listen on 127.0.0.1"
        )
    try:
        server = socket.create_server((host, port))
    except OSError as problem:
        raise UsageError(
            f"cannot listen at {address} ({problem.strerror}); name an address of this computer "
            "and a port that is free"
        ) from problem
    return server, peer


def _is_loopback(host: str) -> bool:
    """Whether only programs of this computer reach it there."""
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _readable(server: socket.socket) -> bool:
    """Whether somebody comes within the time between two polls."""
    return bool(select.select([server], [], [], LOOK)[0])
