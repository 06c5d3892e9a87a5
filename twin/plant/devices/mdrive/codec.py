"""Commands and replies of an MDrive in party mode. Values in, bytes out; bytes in, values out.

A reply does not say whose it is, nor to what. So each question prints a tag of its own before the
values: what is late, doubled or another drive's cannot be taken for the answer. In whatever echo
mode the drive is, the answer is found by that tag; prompts, echoes and empty lines are passed over.
"""

import re
from collections.abc import Sequence
from enum import Enum

from twin.plant.devices.mdrive.tables import ACKNOWLEDGE, END, LONGEST, REFUSE

_KEPT = 512
"""Bytes of a reply that are looked at; the longest answer has less than 100."""
_NUMBERS = rb"(-?\d{1,10}(?:(?:_|, )-?\d{1,10})*)"
_BETWEEN = re.compile("_|, ")


def checksum(text: bytes) -> int:
    """Two's complement of the sum of the characters, with the highest bit set."""
    return -sum(text) & 0xFF | 0x80


def frame(address: str, command: str, *, checked: bool) -> bytes:
    """A command to one drive.

    Raises:
        ValueError: longer than a drive's buffer, or not in ASCII.
    """
    text = (address + command).encode("ascii")
    if checked:
        text += bytes([checksum(text)])
    if len(text) > LONGEST:
        raise ValueError(f"{command!r} has more than {LONGEST} characters")
    return text + END


def question(tag: str, items: Sequence[str]) -> str:
    """The command that prints the tag and then the items, one line."""
    return f'PR "{tag}"' + ',"_"'.join(items)


class State(Enum):
    """How far an exchange has come."""

    waiting = "the answer is not there yet"
    done = "the answer is there, or the acknowledgement"
    refused = "the drive has refused the command (NAK): it came with a wrong checksum"
    corrupt = "an answer came with a wrong checksum"


class Answer:
    """What comes back after a question."""

    def __init__(self, tag: str, *, checked: bool) -> None:
        self._checked = checked
        check = rb"(?:([\x80-\xff])[\r\n]|[\r\n]{1,2}([\x80-\xff]))" if checked else rb"[\r\n]"
        self._pattern = re.compile(re.escape(tag.encode("ascii")) + _NUMBERS + check)
        self._tag = tag.encode("ascii")
        self._buffer = b""
        self.values: tuple[int, ...] = ()
        self.state = State.waiting

    def feed(self, data: bytes) -> State:
        """Take what has arrived."""
        if self.state is not State.waiting:
            return self.state
        self._buffer = (self._buffer + data)[-_KEPT:]
        found = self._pattern.search(self._buffer)
        if found is None:
            if bytes([REFUSE]) in self._buffer:
                self.state = State.refused
        elif self._checked and checksum(self._tag + found[1]) != (found[2] or found[3])[0]:
            self.state = State.corrupt
        else:
            self.values = tuple(map(int, _BETWEEN.split(found[1].decode("ascii"))))
            self.state = State.done
        return self.state


class Acknowledgement:
    """What comes back after a command that prints nothing.

    Nobody relies on it: what was commanded is read back. It says only when the next may be sent.
    """

    def __init__(self, sent: bytes, *, echo_mode: int, checked: bool) -> None:
        self._echo = sent.rstrip(END)
        self._echo_mode, self._checked = echo_mode, checked
        self._buffer = b""
        self.state = State.done if echo_mode == 2 else State.waiting

    def feed(self, data: bytes) -> State:
        """Take what has arrived."""
        if self.state is not State.waiting:
            return self.state
        self._buffer = (self._buffer + data)[-_KEPT:]
        rest = self._buffer.replace(self._echo, b"")
        if self._checked:
            if bytes([ACKNOWLEDGE]) in rest:
                self.state = State.done
            elif bytes([REFUSE]) in rest:
                self.state = State.refused
        elif self._echo_mode == 0:
            if b">" in rest or b"?" in rest:
                self.state = State.done
        elif b"\n" in rest:
            self.state = State.done
        return self.state
