"""The messages of one topic of a ROS 1 bag (`.bag`) or a ROS 2 bag (`.db3`), with rosbags."""

from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from twin.errors import LogError
from twin.recording.formats.extras import imported
from twin.recording.formats.topic import Topic
from twin.stop import Stopped, check

CHECKED = 10_000
"""Messages between two looks whether to stop."""


def read_bag(path: Path, name: str | None) -> Topic:
    """Read a topic; without a name, the only one.

    Raises:
        LogError: no bag, no such topic, or rosbags is not installed; with the topics.
    """
    with _opened(path) as reader:
        return _topic(path, name, reader)


def types_in_bag(path: Path) -> dict[str, str]:
    """Topics and the names of their types.

    Raises:
        LogError: no bag, or rosbags is not installed.
    """
    with _opened(path) as reader:
        return {one.topic: _plain(one.msgtype) for one in reader.connections}


@contextmanager
def _opened(path: Path) -> Generator[Any]:
    highlevel = imported("rosbags.highlevel", path)
    typesys = imported("rosbags.typesys", path)
    # bags of ROS 2 did not carry their types before Iron
    usual = typesys.get_typestore(typesys.Stores.LATEST)
    try:
        with highlevel.AnyReader([path], default_typestore=usual) as reader:
            yield reader
    except (LogError, Stopped):
        raise
    except Exception as problem:  # on damaged bytes the reader raises what its parts raise
        text = str(problem).split("\n", 1)[0] or type(problem).__name__
        remedy = "copy it again from where it was recorded"
        if path.suffix.lower() == ".bag":
            remedy += ", or repair it with `rosbag reindex`"
        raise LogError(path, f"cannot be read as a ROS bag ({text})", remedy) from None


def _topic(path: Path, name: str | None, reader: Any) -> Topic:
    types = {one.topic: one.msgtype for one in reader.connections}
    if not types:
        raise LogError(path, "holds no topic", "record it again")
    listed = ", ".join(f"{topic} ({_plain(types[topic])})" for topic in sorted(types))
    if name is None and len(types) == 1:
        (name,) = types
    if name is None or name not in types:
        problem = "holds several topics" if name is None else f"has no topic {name!r}"
        raise LogError(path, problem, f"name one of its topics in `topic`: {listed}")
    connections = [one for one in reader.connections if one.topic == name]
    kinds = {one.msgtype for one in connections}
    if len(kinds) > 1:
        raise LogError(
            path,
            f"has messages of several types on {name}: {', '.join(map(_plain, sorted(kinds)))}",
            "record them on topics of their own",
        )
    (kind,) = kinds
    times: list[int] = []
    messages: list[bytes] = []
    for _, time, message in reader.messages(connections=connections):
        if len(times) % CHECKED == 0:
            check()
        times.append(time)
        messages.append(bytes(message))
    if not messages:
        raise LogError(path, f"has no whole message on {name}", "record it again")
    types_known = reader.typestore
    decode = types_known.deserialize_cdr if reader.is2 else types_known.deserialize_ros1
    return Topic(
        path=path,
        name=name,
        encoding="cdr" if reader.is2 else "ros1",
        type=_plain(kind),
        messages=messages,
        decode=lambda message: decode(message, kind),
        log_time=times,
        publish_time=times,
        whole=True,
    )


def _plain(kind: str) -> str:
    return kind.replace("/msg/", "/")
