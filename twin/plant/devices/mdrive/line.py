"""Questions and commands to the drives of one line, one after the other, with retries."""

import itertools
import string
import time
from collections.abc import Sequence
from dataclasses import dataclass

from twin.plant.devices.device import Counters
from twin.plant.devices.mdrive.codec import Acknowledgement, Answer, State, frame, question
from twin.plant.devices.mdrive.tables import END
from twin.plant.devices.port import Port

_OWN_TIME = 0.09
"""What drive and adapter may add to the time on the line [s]: 5 ms to execute, 2 x 16 ms of a USB
adapter's latency, and as much again."""
_ANSWER_BYTES = 48
_TRIES = 3


@dataclass
class Mode:
    """How a drive talks now."""

    echo: int = 0
    checked: bool = False


class Line:
    """Half-duplex: nobody speaks before the answer or its time is over."""

    def __init__(self, port: Port, counters: Counters) -> None:
        self._port, self._counters = port, counters
        self._letters = itertools.cycle(string.ascii_letters)
        self.heard = 0.0
        """When the last answer was complete, `time.monotonic` [s]."""
        self.wire = 0.0
        """How long that answer took on the line, at most [s]."""

    def activate(self) -> None:
        """The bare end of line that wakes party mode after power-up; harmless at other times."""
        self._port.write(END)
        time.sleep(0.01 + self._port.byte_time)

    def ask(
        self, address: str, items: Sequence[str], mode: Mode, tries: int = _TRIES
    ) -> tuple[int, ...] | None:
        """Values of the items; None: no answer that can be trusted."""
        for _ in range(tries):
            tag = address + next(self._letters)
            answer = Answer(tag, checked=mode.checked)
            sent = frame(address, question(tag, items), checked=mode.checked)
            state = self._exchange(sent, answer)
            if state is State.done:
                self._counters.frames += 1
                self.wire = _ANSWER_BYTES // 2 * self._port.byte_time
                return answer.values
            self._count(state)
        return None

    def tell(self, address: str, command: str, mode: Mode, tries: int = _TRIES) -> bool:
        """Send a command; whether it was acknowledged. Only what was refused is sent again."""
        sent = frame(address, command, checked=mode.checked)
        for _ in range(tries):
            heard = Acknowledgement(sent, echo_mode=mode.echo, checked=mode.checked)
            state = self._exchange(sent, heard)
            if state is State.done:
                return True
            self._count(state)
            if state is not State.refused:
                break
        return False

    def _exchange(self, sent: bytes, reply: Answer | Acknowledgement) -> State:
        self._port.waiting()
        self._port.write(sent)
        if reply.state is State.done:
            # nothing comes back: give the drive time to execute
            time.sleep(len(sent) * self._port.byte_time + 0.008)
            return State.done
        wire = (2 * len(sent) + _ANSWER_BYTES) * self._port.byte_time
        deadline = time.monotonic() + wire + _OWN_TIME
        while (left := deadline - time.monotonic()) > 0.0:
            state = reply.feed(self._port.read(min(left, 0.02)))
            if state is not State.waiting:
                break
        self.heard = time.monotonic()
        return reply.state

    def _count(self, state: State) -> None:
        self._counters.timeouts += state is State.waiting
        self._counters.bad_checksums += state in (State.corrupt, State.refused)
