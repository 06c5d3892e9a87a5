"""A file of messages: its topics, and passes over the messages on some of them."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from twin.errors import LogError
from twin.recording.formats.one_pass import Say, silent

FIRST = 2000
"""Messages that a look at a topic needs."""
FIRST_BYTES = 4 << 20
"""And their size at most, beyond the first message [bytes]."""
CHECKED = 1000
"""Messages between two looks whether to stop."""


class Message(NamedTuple):
    """As recorded."""

    topic: str
    data: bytes
    log_time: int
    """[ns]"""
    publish_time: int
    """[ns]"""


@dataclass(frozen=True)
class Topic:
    """What the messages on a topic are."""

    path: Path
    name: str
    encoding: str
    """"cdr" (ROS 2), "ros1", "json" or "protobuf"."""
    type: str
    """Name of the messages' type, ROS's without `msg/`; empty without one."""
    decode: Callable[[bytes], Any]
    """A message -> an object with attributes (ROS, protobuf), or what JSON gives."""

    @property
    def ros(self) -> bool:
        """Whether these are messages of ROS, whose numbers have names and types."""
        return self.encoding in ("cdr", "ros1")

    def decoded(self, message: Message, number: int) -> Any:
        """A message, the one of that number (from 1).

        Raises:
            LogError: it cannot be decoded; says which.
        """
        try:
            return self.decode(message.data)
        except Exception as problem:  # decoders raise what their parts raise
            raise LogError(
                self.path,
                f"message {number} on {self.name} cannot be decoded ({_short(problem)})",
                "record it again",
            ) from None


class Messages(ABC):
    """All messages of a file. None is kept: each pass reads the file from its beginning."""

    def __init__(self, path: Path, say: Say = silent) -> None:
        self.path = path
        self.whole = True
        """False when a pass found that the file ends in the middle, or is damaged there."""
        self._say = say
        self._ahead: Generator[Message] | None = None
        self._first: dict[str, Message] = {}
        self._beginnings: dict[str, list[Message]] = {}

    @abstractmethod
    def types(self) -> Mapping[str, str]:
        """Topics and the names of their types.

        Raises:
            LogError: the file cannot be read.
        """

    @abstractmethod
    def topic(self, name: str | None) -> Topic:
        """A topic; without a name, the only one.

        Raises:
            LogError: no such topic, or one that is not read; with the topics.
        """

    @abstractmethod
    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[Message]:
        """One pass over the messages on these topics; on all of them without any."""

    def read(self, topics: Collection[str]) -> Iterator[Message]:
        """The pass that is told to who waits for it."""
        if self._ahead is not None:
            self._ahead.close()
            self._ahead = None
        return self.messages(topics, self._say)

    def first(self, topic: str) -> Message | None:
        """The first message on a topic; None where there is none.

        It is looked for once for all topics, from the beginning on and no further than needed.
        """
        if self._ahead is None and topic not in self._first:
            self._ahead = self.messages()
        while topic not in self._first:
            message = next(self._ahead, None) if self._ahead is not None else None
            if message is None:
                return None
            self._first.setdefault(message.topic, message)
        return self._first[topic]

    def look(self, topics: Collection[str]) -> None:
        """Read the beginnings of these topics in one pass, which ends when each has enough."""
        found: dict[str, list[Message]] = {name: [] for name in topics}
        room = dict.fromkeys(topics, FIRST_BYTES)
        waiting = set(topics)
        for message in self.messages(topics) if topics else ():
            name = message.topic
            if name not in waiting:
                continue
            found[name].append(message)
            room[name] -= len(message.data)
            if len(found[name]) == FIRST or room[name] < 0:
                waiting.remove(name)
            if not waiting:
                break
        self._beginnings |= found
        self._first |= {name: messages[0] for name, messages in found.items() if messages}

    def beginning(self, topic: Topic) -> "Messages":
        """The first messages on a topic."""
        if topic.name not in self._beginnings:
            self.look([topic.name])
        return _Beginning(topic, self._beginnings[topic.name])


class _Beginning(Messages):
    """The first messages on one topic, in memory."""

    def __init__(self, topic: Topic, messages: Sequence[Message]) -> None:
        super().__init__(topic.path)
        self._topic, self._messages = topic, messages

    def types(self) -> Mapping[str, str]:
        return {self._topic.name: self._topic.type}

    def topic(self, name: str | None) -> Topic:
        return self._topic

    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[Message]:
        yield from self._messages


def _short(problem: Exception) -> str:
    """An error's first line."""
    return str(problem).split("\n", 1)[0] or type(problem).__name__
