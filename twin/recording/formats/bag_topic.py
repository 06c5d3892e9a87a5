"""The messages of a ROS 1 bag (`.bag`) or a ROS 2 bag (`.db3`), with rosbags."""

from collections.abc import Collection, Generator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin.errors import LogError
from twin.recording.formats.extras import imported
from twin.recording.formats.one_pass import Progress, Say, silent
from twin.recording.formats.topic import CHECKED, Message, Messages, Topic
from twin.stop import Stopped, check


class BagMessages(Messages):
    """A bag."""

    def __init__(self, path: Path, say: Say = silent) -> None:
        """Read what the bag says of its topics.

        Raises:
            LogError: no bag, or rosbags is not installed.
        """
        super().__init__(path, say)
        with _opened(path) as reader:
            self._kinds: dict[str, set[str]] = {}
            for one in reader.connections:
                self._kinds.setdefault(one.topic, set()).add(one.msgtype)
            self._types_known, self._is2 = reader.typestore, reader.is2

    def types(self) -> Mapping[str, str]:
        return {topic: _plain(max(kinds)) for topic, kinds in self._kinds.items()}

    def topic(self, name: str | None) -> Topic:
        types = self.types()
        if not types:
            raise LogError(self.path, "holds no topic", "record it again")
        listed = ", ".join(f"{topic} ({types[topic]})" for topic in sorted(types))
        if name is None and len(types) == 1:
            (name,) = types
        if name is None or name not in types:
            problem = "holds several topics" if name is None else f"has no topic {name!r}"
            raise LogError(self.path, problem, f"name one of its topics in `topic`: {listed}")
        kinds = self._kinds[name]
        if len(kinds) > 1:
            raise LogError(
                self.path,
                f"has messages of several types on {name}: {', '.join(map(_plain, sorted(kinds)))}",
                "record them on topics of their own",
            )
        (kind,) = kinds
        known = self._types_known
        decode = known.deserialize_cdr if self._is2 else known.deserialize_ros1
        return Topic(
            path=self.path,
            name=name,
            encoding="cdr" if self._is2 else "ros1",
            type=_plain(kind),
            decode=lambda message: decode(message, kind),
        )

    def messages(
        self, topics: Collection[str] | None = None, say: Say = silent
    ) -> Generator[Message]:
        progress = Progress(say, self.path)
        with _opened(self.path) as reader:
            asked = [one for one in reader.connections if topics is None or one.topic in topics]
            count = sum(one.msgcount for one in asked)
            if not asked:  # which the reader would take for all
                return
            passed = enumerate(reader.messages(connections=asked))
            for number, (connection, time, message) in passed:
                if number % CHECKED == 0:
                    check()
                    progress.at(number, count)
                yield Message(connection.topic, bytes(message), time, time)


@contextmanager
def _opened(path: Path) -> Generator[Any]:
    highlevel = imported("rosbags.highlevel", path)
    typesys = imported("rosbags.typesys", path)
    # bags of ROS 2 did not carry their types before Iron
    usual = typesys.get_typestore(typesys.Stores.LATEST)
    try:
        with highlevel.AnyReader([path], default_typestore=usual) as reader:
            yield reader
    except (LogError, Stopped, GeneratorExit):
        raise
    except Exception as problem:  # on damaged bytes the reader raises what its parts raise
        text = str(problem).split("\n", 1)[0] or type(problem).__name__
        remedy = "copy it again from where it was recorded"
        if path.suffix.lower() == ".bag":
            remedy += ", or repair it with `rosbag reindex`"
        raise LogError(path, f"cannot be read as a ROS bag ({text})", remedy) from None


def _plain(kind: str) -> str:
    return kind.replace("/msg/", "/")
