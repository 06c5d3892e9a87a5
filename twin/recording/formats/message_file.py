"""One topic of a recording as columns: of each message, the numbers that the stream asks for."""

from array import array
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.message_fields import fields_of
from twin.recording.formats.number_file import NumberFile
from twin.recording.formats.one_pass import Names, Tables
from twin.recording.formats.topic import Message, Messages, Topic

Array = NDArray[np.float64]

ARRIVAL = ("log_time", "publish_time")
"""Clocks of the recorder, which every message has."""
STAMPS = ("header.stamp", "timestamp")
"""Clocks of the sender."""


class MessageFile(NumberFile):
    """A topic for a stream in an SI unit: an Imu gives rates to one in rad/s.

    The time is by default the stamp in a ROS message's header, else when it was logged.
    """

    def __init__(
        self,
        messages: Messages,
        topic: Topic,
        unit: str,
        readers: "list[MessageFile] | None" = None,
    ) -> None:
        """Look into the first message.

        Args:
            messages: of the file.
            topic: one of its topics.
            unit: SI unit of the stream.
            readers: those of the same file that expect numbers, which one pass reads for all;
                this one joins them when it does.

        Raises:
            LogError: there is none, or no number in it is in that unit.
        """
        first = messages.first(topic.name)
        if first is None:
            raise LogError(topic.path, f"has no whole message on {topic.name}", "record it again")
        fields = fields_of(topic, topic.decoded(first, 1), unit)
        stamps = [name for name in fields.clocks if topic.ros and name in STAMPS]
        self._arrival = [name for name in ARRIVAL if name not in fields.values]
        own = {**dict.fromkeys(stamps), **dict.fromkeys(self._arrival), **fields.clocks}
        usual = fields.usual or ()
        names = (*usual, *(name for name in fields.values if name not in usual))
        super().__init__(topic.path, (*own, *names), tuple(own))
        self.topic, self.tables = topic, Tables()
        self._messages, self._unit = messages, unit
        self._readers: list[MessageFile] = [] if readers is None else readers
        self._usual = fields.usual
        self.by_name = len(usual) == 4 and usual[0].endswith(".w")
        self._get = {**fields.values, **fields.clocks}

    @property
    def values(self) -> tuple[str, ...]:
        """What the message's type is known for; else all of its numbers."""
        if self._usual is not None:
            return self._usual
        return tuple(name for name in super().values if not name.startswith("header."))

    def expect(self, names: Sequence[str]) -> None:
        self.tables.expect([self.find(name) for name in names])
        if self not in self._readers:
            self._readers.append(self)

    def numbers(self, names: Sequence[str]) -> Array:
        names = tuple(self.find(name) for name in names)
        if names not in self.tables:
            self._read(names)
        table = self.tables.take(names)
        for index, name in enumerate(names):
            if name in STAMPS and not table[:, index].any():
                raise self.fault(f"{name} is 0 in every message", 'write time = "log_time"')
        return table

    def _read(self, names: Names) -> None:
        """Fill that table, and those that any reader of the file expects, in one pass."""
        wanted = {reader: reader.tables.missing() for reader in self._readers}
        wanted[self] = [names, *wanted.get(self, [])]
        fillings = [_Filling(reader, tables) for reader, tables in wanted.items() if tables]
        on: dict[str, list[_Filling]] = {}
        for filling in fillings:
            on.setdefault(filling.file.topic.name, []).append(filling)
        for message in self._messages.read(on):
            first, *others = on[message.topic]
            decoded = first.file.topic.decoded(message, first.count + 1)
            first.add(message, decoded)
            for filling in others:
                filling.add(message, decoded)
        for filling in fillings:
            file = filling.file
            file.tables.fill(filling.tables)
            if not self._messages.whole:
                file.repairs = (
                    f"{file.path.name} was cut short or is damaged; {filling.count} whole messages "
                    f"on {file.topic.name} are here",
                )

    def beginning(self) -> "MessageFile":
        """Of its first messages."""
        return MessageFile(self._messages.beginning(self.topic), self.topic, self._unit)

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        where = "" if row is None else f" (message {row + 1} on {self.topic.name})"
        return LogError(self.path, problem + where, remedy)

    def getter(self, name: str) -> Callable[[Message, Any], Any]:
        """What takes a column's number out of a message and what it decodes to."""
        if name == "log_time" and name in self._arrival:
            return lambda message, _: message.log_time / 1e9
        if name == "publish_time" and name in self._arrival:
            return lambda message, _: message.publish_time / 1e9
        get = self._get[name]
        return lambda _, decoded: get(decoded)


class _Filling:
    """The tables that a pass fills for one reader of a topic."""

    def __init__(self, file: MessageFile, wanted: Iterable[Names]) -> None:
        self.file = file
        self.tables = {names: array("d") for names in dict.fromkeys(wanted)}
        self.count = 0
        """Messages so far."""
        self._columns = [
            (name, file.getter(name), rows) for names, rows in self.tables.items() for name in names
        ]

    def add(self, message: Message, decoded: Any) -> None:
        """Append what a message has in each column; NaN where it has nothing."""
        for name, get, rows in self._columns:
            try:
                value = get(message, decoded)
            except (TypeError, AttributeError):  # a stamp is incomplete
                value = None
            try:
                rows.append(np.nan if value is None else float(value))
            except (TypeError, ValueError, OverflowError):
                raise self.file.fault(
                    f"column {name!r} holds {value!r}, which is no finite number",
                    "write the number, or name other `columns`",
                    self.count,
                ) from None
        self.count += 1
