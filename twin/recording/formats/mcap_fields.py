"""Which numbers a message holds, by dotted name, and how to get at them."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, cast

from twin.errors import LogError
from twin.recording.formats.mcap_topic import Topic

Getter = Callable[[Any], Any]

DEEPEST = 8
"""Levels of nested messages that are looked into."""

_VECTOR, _QUATERNION = ("x", "y", "z"), ("w", "x", "y", "z")
_ROS2 = {
    ("sensor_msgs/Imu", "rad/s"): ("angular_velocity", _VECTOR),
    ("sensor_msgs/Imu", "m/s^2"): ("linear_acceleration", _VECTOR),
    ("sensor_msgs/Imu", "1"): ("orientation", _QUATERNION),
    ("geometry_msgs/QuaternionStamped", "1"): ("quaternion", _QUATERNION),
}
"""Type and SI unit of the stream -> the field it is in, and that field's own."""

_JOINT = {
    "rad": "position",
    "m": "position",
    "rad/s": "velocity",
    "m/s": "velocity",
    "N m": "effort",
    "N": "effort",
}
"""SI unit of the stream -> the list of a JointState it is in."""

_STAMPS = (("sec", "nanosec"), ("sec", "nsec"), ("seconds", "nanos"))
"""How messages write a time: whole seconds, and nanoseconds of the next."""


@dataclass(frozen=True)
class Fields:
    """The numbers in the messages of a topic."""

    values: Mapping[str, Getter]
    clocks: Mapping[str, Getter]
    """Times [s]."""


def fields_of(topic: Topic, unit: str) -> Fields:
    """What the messages hold for a stream in that SI unit; JSON and Protobuf as the first has it.

    Raises:
        LogError: nothing.
    """
    first = topic.messages[0]
    if topic.type == "sensor_msgs/JointState" and topic.encoding == "cdr":
        fields = _joints(first, _JOINT.get(unit))
    elif topic.encoding == "cdr":
        fields = _ros2(topic, first, unit)
    else:
        values: dict[str, Getter] = {}
        clocks: dict[str, Getter] = {}
        kind = _json if topic.encoding == "json" else _protobuf
        kind("", first, lambda message: message, values, clocks, 0)
        fields = Fields(values, clocks)
    if not fields.values:
        what = f" in {unit}" if topic.encoding == "cdr" else ""
        kind = " ".join(filter(None, [topic.type, f"on {topic.name}"]))
        raise LogError(topic.path, f"{kind} holds no number{what}", "name another `topic`")
    return fields


def _ros2(topic: Topic, first: Any, unit: str) -> Fields:
    field, columns = _ROS2.get((topic.type, unit), ("", ()))
    covariance = getattr(first, f"{field}_covariance", None)
    if covariance is not None and covariance[0] == -1.0:
        # the convention of sensor_msgs/Imu for a sensor that has no such reading
        raise LogError(
            topic.path,
            f"{topic.name} says by its covariance that it has no {field}",
            "name another `topic`",
        )
    values = {f"{field}.{axis}": attrgetter(f"{field}.{axis}") for axis in columns}
    return Fields(values, {"header.stamp": _stamp})


def _joints(first: Any, field: str | None) -> Fields:
    if field is None or not getattr(first, field):
        return Fields({}, {})

    def getter(joint: str) -> Getter:
        def get(message: Any) -> Any:
            return dict(zip(message.name, getattr(message, field), strict=False)).get(joint)

        return get

    return Fields({joint: getter(joint) for joint in first.name}, {"header.stamp": _stamp})


def _stamp(message: Any) -> float:
    stamp = message.header.stamp
    return stamp.sec + 1e-9 * stamp.nanosec


def _json(
    name: str,
    value: Any,
    get: Getter,
    values: dict[str, Getter],
    clocks: dict[str, Getter],
    depth: int,
) -> None:
    if isinstance(value, int | float):
        values[name or "value"] = get
    elif isinstance(value, dict | list) and depth < DEEPEST:
        if isinstance(value, list):
            entries = enumerate(cast(list[Any], value))
        else:
            entries = cast(dict[str, Any], value).items()
        parts = dict(entries)
        pair = next((pair for pair in _STAMPS if set(parts) == set(pair)), None)
        if pair is not None and name:
            clocks[name] = _seconds(_entry(get, pair[0]), _entry(get, pair[1]))
            return
        for key, part in parts.items():
            inner = f"{name}.{key}" if name else str(key)
            _json(inner, part, _entry(get, key), values, clocks, depth + 1)


def _protobuf(
    name: str,
    value: Any,
    get: Getter,
    values: dict[str, Getter],
    clocks: dict[str, Getter],
    depth: int,
) -> None:
    if depth > DEEPEST:
        return
    if name and value.DESCRIPTOR.full_name == "google.protobuf.Timestamp":
        clocks[name] = _seconds(_attribute(get, "seconds"), _attribute(get, "nanos"))
        return
    for field in value.DESCRIPTOR.fields:
        inner = f"{name}.{field.name}" if name else field.name
        part, take = getattr(value, field.name), _attribute(get, field.name)
        number = field.cpp_type not in (field.CPPTYPE_STRING, field.CPPTYPE_MESSAGE)
        if field.is_repeated:
            for index in range(len(part)) if number else ():
                values[f"{inner}.{index}"] = _entry(take, index)
        elif number:
            values[inner] = take
        elif field.cpp_type == field.CPPTYPE_MESSAGE:
            _protobuf(inner, part, take, values, clocks, depth + 1)


def _attribute(get: Getter, name: str) -> Getter:
    return lambda message: getattr(get(message), name)


def _entry(get: Getter, key: str | int) -> Getter:
    """An entry of a dict or list; None where a message has none."""

    def entry(message: Any) -> Any:
        try:
            return get(message)[key]
        except (KeyError, IndexError, TypeError):
            return None

    return entry


def _seconds(whole: Getter, nanoseconds: Getter) -> Getter:
    return lambda message: whole(message) + 1e-9 * nanoseconds(message)
