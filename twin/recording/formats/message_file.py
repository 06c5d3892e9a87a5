"""One topic of a recording as columns: of each message, the numbers that the stream asks for."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.message_fields import fields_of
from twin.recording.formats.number_file import NumberFile
from twin.recording.formats.topic import Topic
from twin.stop import check

Array = NDArray[np.float64]

ARRIVAL = ("log_time", "publish_time")
"""Clocks of the recorder, which every message has."""
STAMPS = ("header.stamp", "timestamp")
"""Clocks of the sender."""
CHECKED = 1000
"""Messages between two looks whether to stop."""


class MessageFile(NumberFile):
    """A topic for a stream in an SI unit: an Imu gives rates to one in rad/s.

    The time is by default the stamp in a ROS message's header, else when it was logged.
    """

    def __init__(self, topic: Topic, unit: str) -> None:
        """Look into the first message.

        Raises:
            LogError: no number in it is in that unit.
        """
        fields = fields_of(topic, unit)
        stamps = [name for name in fields.clocks if topic.ros and name in STAMPS]
        self._arrival = [name for name in ARRIVAL if name not in fields.values]
        own = {**dict.fromkeys(stamps), **dict.fromkeys(self._arrival), **fields.clocks}
        usual = fields.usual or ()
        names = (*usual, *(name for name in fields.values if name not in usual))
        super().__init__(topic.path, (*own, *names), tuple(own))
        self._topic, self._unit = topic, unit
        self._usual = fields.usual
        self.by_name = len(usual) == 4 and usual[0].endswith(".w")
        self._get = {**fields.values, **fields.clocks}
        if not topic.whole:
            count = len(topic.messages)
            self.repairs = (
                f"{topic.path.name} was cut short or is damaged; {count} whole messages on "
                f"{topic.name} are here",
            )

    @property
    def values(self) -> tuple[str, ...]:
        """What the message's type is known for; else all of its numbers."""
        if self._usual is not None:
            return self._usual
        return tuple(name for name in super().values if not name.startswith("header."))

    def numbers(self, names: Sequence[str]) -> Array:
        found = [self.find(name) for name in names]
        columns: dict[str, list[Any]] = {name: [] for name in found if name not in self._arrival}
        for number, message in enumerate(self._topic.decoded() if columns else ()):
            if number % CHECKED == 0:
                check()
            for name, column in columns.items():
                column.append(_taken(self._get[name], message))
        return np.stack([self._column(name, columns.get(name, [])) for name in found], axis=-1)

    def beginning(self) -> "MessageFile":
        """Of its first messages."""
        return MessageFile(self._topic.beginning(), self._unit)

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        where = "" if row is None else f" (message {row + 1} on {self._topic.name})"
        return LogError(self.path, problem + where, remedy)

    def _column(self, name: str, raw: list[Any]) -> Array:
        if name in self._arrival:
            return np.array(getattr(self._topic, name), dtype=np.int64) / 1e9
        try:
            column = np.array(raw, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            row = next(i for i, x in enumerate(raw) if not _is_number(x))
            raise self.fault(
                f"column {name!r} holds {raw[row]!r}, which is no finite number",
                "write the number, or name other `columns`",
                row,
            ) from None
        if name in STAMPS and not column.any():
            raise self.fault(f"{name} is 0 in every message", 'write time = "log_time"')
        return column


def _taken(get: Callable[[Any], Any], message: Any) -> Any:
    """What the message has there; None where a stamp is incomplete."""
    try:
        return get(message)
    except (TypeError, AttributeError):
        return None


def _is_number(value: Any) -> bool:
    """That a float can hold, or none at all."""
    try:
        return value is None or isinstance(float(value), float)
    except (TypeError, ValueError, OverflowError):
        return False
