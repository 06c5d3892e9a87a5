"""Emulated devices on pseudo-terminals, in a process of their own, at their lines' true rates."""

import multiprocessing
import os
import select
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing.connection import Connection
from pathlib import Path
from types import TracebackType
from typing import Self

from twin.emulate.emulated import EmulatedDevice
from twin.emulate.faults import Fault
from twin.emulate.server import BEAT, Server
from twin.errors import DeviceError, TwinError
from twin.processes import beginning
from twin.stop import LOOK, ignore, until

_START = 60.0
"""Longest wait for the process [s]: it may have a machine to compile."""

MadeDevices = Callable[[], Mapping[str, EmulatedDevice]]


class EmulatedLines:
    """Starts the process on entry, ends it on exit; faults are scheduled or injected."""

    def __init__(
        self,
        devices: MadeDevices,
        links: Mapping[str, Path],
        faults: Sequence[Fault] = (),
        *,
        seed: int = 0,
        log: Path | None = None,
        lockstep: bool = False,
    ) -> None:
        """Nothing is started yet.

        Args:
            devices: makes them by their names, in the process where they will live; what they
                share, they share there.
            links: will name their ports; the first name's is the device of faults without one.
            faults: counted from the start.
            seed: of the faults.
            log: takes the raw bytes of all directions.
            lockstep: time passes by `go_on` only (`twin.lockstep`); for a single device.
        """
        self.links = dict(links)
        # A fork would copy the threads' locks of whoever starts this.
        context = multiprocessing.get_context("forkserver")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve,
            args=(devices, self.links, tuple(faults), seed, log, theirs, lockstep),
            daemon=True,
        )

    def __enter__(self) -> Self:
        """Start it, and wait until its ports are there.

        Raises:
            TwinError: what its devices refuse, as they would in this process.
            DeviceError: it ended at once, or took too long.
            Stopped: a stop was requested meanwhile.
        """
        with beginning():
            self._process.start()
        said = self._not_there(f"did not start within {_START:g} s")
        try:
            ready = until(lambda: self._pipe.poll(min(LOOK, _START)), _START)
        except BaseException:
            self.kill()
            raise
        if ready:
            try:
                said = self._pipe.recv()
            except EOFError:
                said = self._not_there("ended before its ports were there")
        if isinstance(said, TwinError):
            self.kill()
            raise said
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._process.is_alive():
            self._pipe.send(None)
            self._process.join(5.0)
        if self._process.is_alive():
            self._process.kill()

    def _not_there(self, problem: str) -> DeviceError:
        names = ", ".join(map(str, self.links.values()))
        remedy = "what it printed says why; else look whether this computer is busy"
        return DeviceError(f"the emulation at {names}", problem, remedy)

    @property
    def alive(self) -> bool:
        """Its process runs."""
        return self._process.is_alive()

    def inject(self, fault: Fault) -> None:
        """Begin a fault; its start counts from now."""
        self._pipe.send(fault)

    def go_on(self, until: float, sent: int) -> tuple[float, int] | None:
        """Let time pass in lockstep, at most until it says something.

        Args:
            until: the emulation's time [s].
            sent: bytes that the host has written so far; they are waited for.

        Returns:
            Its time [s], and how many bytes it has said so far; None: it is gone.
        """
        try:
            self._pipe.send((until, sent))
            while not self._pipe.poll(0.5):
                if not self.alive:
                    return None
            return self._pipe.recv()
        except (EOFError, OSError):
            return None

    def kill(self) -> None:
        """End the process at once, as a crash does."""
        self._process.kill()
        self._process.join(5.0)


class EmulatedLine(EmulatedLines):
    """One device on its line."""

    def __init__(
        self,
        device: EmulatedDevice | Callable[[], EmulatedDevice],
        link: Path,
        faults: Sequence[Fault] = (),
        *,
        seed: int = 0,
        log: Path | None = None,
        lockstep: bool = False,
    ) -> None:
        """`link` will name the port; `log` takes the raw bytes of both directions.

        A `device` that cannot travel to another process is made there: give what makes it.
        """
        self.link = link
        made = _Alone(device)
        super().__init__(made, {"": link}, faults, seed=seed, log=log, lockstep=lockstep)


class _Alone:
    """Makes a single device, without a name."""

    def __init__(self, device: EmulatedDevice | Callable[[], EmulatedDevice]) -> None:
        self._device = device

    def __call__(self) -> dict[str, EmulatedDevice]:
        device = self._device
        return {"": device if isinstance(device, EmulatedDevice) else device()}


def _serve(
    devices: MadeDevices,
    links: Mapping[str, Path],
    faults: tuple[Fault, ...],
    seed: int,
    log: Path | None,
    pipe: Connection,
    lockstep: bool,
) -> None:
    """Be the devices until told to stop, or until whoever started this is gone."""
    # A request to stop is meant for the loop, which still has to bring the devices to rest.
    ignore()
    first = next(iter(links))
    try:
        made = devices()
    except TwinError as mistake:
        pipe.send(mistake)
        return
    start = time.monotonic()
    servers: dict[str, Server] = {}
    for name, link in links.items():
        own = tuple(fault for fault in faults if (fault.device or first) == name)
        servers[name] = Server(made[name], link, own, seed, start=start, lockstep=lockstep)
    pipe.send("ready")
    with open(log, "wb", buffering=0) if log else open(os.devnull, "wb") as record:
        while True:
            try:
                while pipe.poll():
                    order = pipe.recv()
                    if order is None:
                        return
                    if isinstance(order, Fault):
                        servers[order.device or first].add(order)
                    else:
                        pipe.send(servers[first].go_on(*order))
            except (EOFError, OSError):
                return
            if lockstep:
                pipe.poll(None)
                continue
            watched: list[int | Connection] = [pipe]
            for name, server in servers.items():
                sent, into = server.step()
                for mark, data in (("<", into), (">", sent)):
                    if data:
                        record.write(f"{name}{mark}{data.hex()}\n".encode())
                watched += server.watched
            # until a host or the owner says something, or the next beat
            select.select(watched, [], [], BEAT)
