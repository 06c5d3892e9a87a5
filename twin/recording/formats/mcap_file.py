"""One topic of an MCAP file as columns: of each message, the numbers that the stream asks for."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.mcap_fields import fields_of
from twin.recording.formats.mcap_topic import Topic
from twin.recording.formats.number_file import NumberFile

Array = NDArray[np.float64]

ARRIVAL = ("log_time", "publish_time")
"""Clocks of the recorder, which every message has."""


class McapFile(NumberFile):
    """A topic for a stream in an SI unit: an Imu gives rates to one in rad/s.

    The time is by default the stamp in a ROS 2 message's header, else when it was logged.
    """

    def __init__(self, topic: Topic, unit: str) -> None:
        """Look into the first message.

        Raises:
            LogError: no number in it is in that unit.
        """
        fields = fields_of(topic, unit)
        stamps = fields.clocks if topic.encoding == "cdr" else {}
        own = {**dict.fromkeys(stamps), **dict.fromkeys(ARRIVAL), **fields.clocks}
        super().__init__(topic.path, (*own, *fields.values), tuple(own))
        self._topic = topic
        self.by_name = topic.encoding == "cdr"
        self._get = {**fields.values, **fields.clocks}
        if not topic.whole:
            count = len(topic.messages)
            self.repairs = (
                f"{topic.path.name} was cut short or is damaged; {count} whole messages on "
                f"{topic.name} are here",
            )

    def numbers(self, names: Sequence[str]) -> Array:
        return np.stack([self._column(self.find(name)) for name in names], axis=-1)

    def fault(self, problem: str, remedy: str, row: int | None = None) -> LogError:
        where = "" if row is None else f" (message {row + 1} on {self._topic.name})"
        return LogError(self.path, problem + where, remedy)

    def _column(self, name: str) -> Array:
        if name in ARRIVAL:
            return np.array(getattr(self._topic, name), dtype=np.int64) / 1e9
        raw = [_taken(self._get[name], message) for message in self._topic.messages]
        try:
            column = np.array(raw, dtype=np.float64)
        except (TypeError, ValueError, OverflowError):
            row = next(i for i, x in enumerate(raw) if not _is_number(x))
            raise self.fault(
                f"column {name!r} holds {raw[row]!r}, which is no finite number",
                "write the number, or name other `columns`",
                row,
            ) from None
        if name == "header.stamp" and not column.any():
            raise self.fault("header.stamp is 0 in every message", 'write time = "log_time"')
        return column


def _taken(get: Callable[[Any], Any], message: Any) -> Any:
    """What the message has there; None where a stamp is incomplete."""
    try:
        return get(message)
    except TypeError:
        return None


def _is_number(value: Any) -> bool:
    """That a float can hold, or none at all."""
    try:
        return value is None or isinstance(float(value), float)
    except (TypeError, ValueError, OverflowError):
        return False
