"""The messages on one topic of a recording, each decoded when it is looked at."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from twin.errors import LogError

FIRST = 2000
"""Messages that a look at a topic needs."""


@dataclass(frozen=True)
class Topic:
    """What a file holds on one topic."""

    path: Path
    name: str
    encoding: str
    """"cdr" (ROS 2), "ros1", "json" or "protobuf"."""
    type: str
    """Name of the messages' type, ROS's without `msg/`; empty without one."""
    messages: list[bytes]
    """As recorded."""
    decode: Callable[[bytes], Any]
    """A message -> an object with attributes (ROS, protobuf), or what JSON gives."""
    log_time: list[int]
    """[ns]"""
    publish_time: list[int]
    """[ns]"""
    whole: bool
    """False when the file ends in the middle, or is damaged from somewhere on."""

    @property
    def ros(self) -> bool:
        """Whether these are messages of ROS, whose numbers have names and types."""
        return self.encoding in ("cdr", "ros1")

    def beginning(self) -> "Topic":
        """The same with its first messages only."""
        return replace(
            self,
            messages=self.messages[:FIRST],
            log_time=self.log_time[:FIRST],
            publish_time=self.publish_time[:FIRST],
        )

    def decoded(self) -> Iterator[Any]:
        """The messages, one after the other.

        Raises:
            LogError: one cannot be decoded; says which.
        """
        for number, message in enumerate(self.messages, 1):
            try:
                yield self.decode(message)
            except Exception as problem:  # decoders raise what their parts raise
                raise LogError(
                    self.path,
                    f"message {number} on {self.name} cannot be decoded ({problem})",
                    "record it again",
                ) from None
