"""Which numbers a message holds, by dotted name, and how to get at them."""

from array import array
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from operator import attrgetter
from typing import Any, cast

import numpy as np

from twin.errors import LogError
from twin.recording.formats.topic import Topic

Getter = Callable[[Any], Any]

DEEPEST = 8
"""Levels of nested messages that are looked into."""

MOST_ENTRIES = 256
"""A longer list is an image or a scan, no sample of a stream."""

_VECTOR, _QUATERNION = ("x", "y", "z"), ("w", "x", "y", "z")
_THREE, _FOUR = ("0", "1", "2"), ("0", "1", "2", "3")
_ROS = {
    "sensor_msgs/Imu": {
        "rad/s": ("angular_velocity", _VECTOR),
        "m/s^2": ("linear_acceleration", _VECTOR),
        "1": ("orientation", _QUATERNION),
    },
    "sensor_msgs/MagneticField": {"T": ("magnetic_field", _VECTOR)},
    "geometry_msgs/QuaternionStamped": {"1": ("quaternion", _QUATERNION)},
    "geometry_msgs/PoseStamped": {
        "1": ("pose.orientation", _QUATERNION),
        "m": ("pose.position", _VECTOR),
    },
    "geometry_msgs/PoseWithCovarianceStamped": {
        "1": ("pose.pose.orientation", _QUATERNION),
        "m": ("pose.pose.position", _VECTOR),
    },
    "geometry_msgs/TransformStamped": {
        "1": ("transform.rotation", _QUATERNION),
        "m": ("transform.translation", _VECTOR),
    },
    "nav_msgs/Odometry": {
        "1": ("pose.pose.orientation", _QUATERNION),
        "m": ("pose.pose.position", _VECTOR),
        "m/s": ("twist.twist.linear", _VECTOR),
        "rad/s": ("twist.twist.angular", _VECTOR),
    },
    "geometry_msgs/TwistStamped": {
        "m/s": ("twist.linear", _VECTOR),
        "rad/s": ("twist.angular", _VECTOR),
    },
    "geometry_msgs/AccelStamped": {"m/s^2": ("accel.linear", _VECTOR)},
    "geometry_msgs/WrenchStamped": {
        "N": ("wrench.force", _VECTOR),
        "N m": ("wrench.torque", _VECTOR),
    },
    "px4_msgs/VehicleAttitude": {"1": ("q", _FOUR)},
    "px4_msgs/SensorCombined": {
        "rad/s": ("gyro_rad", _THREE),
        "m/s^2": ("accelerometer_m_s2", _THREE),
    },
    "px4_msgs/VehicleAngularVelocity": {"rad/s": ("xyz", _THREE)},
}
"""Type -> SI unit of the stream -> the field it is in, and that field's own."""
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
    usual: tuple[str, ...] | None = None
    """Names of those that are the stream, where the type says which."""


def fields_of(topic: Topic, first: Any, unit: str) -> Fields:
    """What the messages hold for a stream in that SI unit; JSON and Protobuf as the first has it.

    Args:
        topic: of the messages.
        first: what the first one decodes to.
        unit: SI unit of the stream.

    Raises:
        LogError: nothing.
    """
    if topic.type == "sensor_msgs/JointState" and topic.ros:
        fields = _joints(first, _JOINT.get(unit))
    elif topic.ros:
        fields = _ros(topic, first, unit)
    else:
        values: dict[str, Getter] = {}
        clocks: dict[str, Getter] = {}
        kind = _json if topic.encoding == "json" else _protobuf
        kind("", first, lambda message: message, values, clocks, 0)
        fields = Fields(values, clocks)
    if not fields.values:
        what = f" in {unit}" if topic.type == "sensor_msgs/JointState" and topic.ros else ""
        kind = " ".join(filter(None, [topic.type, f"on {topic.name}"]))
        raise LogError(topic.path, f"{kind} holds no number{what}", "name another `topic`")
    return fields


def _ros(topic: Topic, first: Any, unit: str) -> Fields:
    """All numbers of a message by their paths, and those that its type is known for."""
    values: dict[str, Getter] = {}
    clocks: dict[str, Getter] = {}
    _attributes("", first, lambda message: message, values, clocks, 0)
    if topic.type.startswith("px4_msgs/") and "timestamp" in values:
        clocks["timestamp"] = lambda message: 1e-6 * message.timestamp
        del values["timestamp"]
    field, columns = _ROS.get(topic.type, {}).get(unit, ("", ()))
    covariance = getattr(first, f"{field}_covariance", None) if field else None
    if covariance is not None and covariance[0] == -1.0:
        # the convention of sensor_msgs/Imu for a sensor that has no such reading
        raise LogError(
            topic.path,
            f"{topic.name} says by its covariance that it has no {field}",
            "name another `topic`",
        )
    usual = tuple(f"{field}.{axis}" for axis in columns) if field else None
    if usual is None and topic.type == "geometry_msgs/Vector3Stamped":
        usual = tuple(f"vector.{axis}" for axis in _VECTOR)
    if usual is None and topic.type in _ROS:
        usual = ()
    return Fields(values, clocks, usual)


def _attributes(
    name: str,
    value: Any,
    get: Getter,
    values: dict[str, Getter],
    clocks: dict[str, Getter],
    depth: int,
) -> None:
    """Numbers of an object with attributes, of lists in it, and of such objects in it."""
    if isinstance(value, int | float | np.number | np.bool_):
        values[name] = get
    elif isinstance(value, str | bytes) or depth > DEEPEST:
        return
    elif isinstance(value, Sequence | np.ndarray | array):
        parts = cast(Sequence[Any], value)
        for index in range(len(parts) if len(parts) <= MOST_ENTRIES else 0):
            _attributes(
                f"{name}.{index}", parts[index], _entry(get, index), values, clocks, depth + 1
            )
    else:
        names = _names(value)
        pair = next((pair for pair in _STAMPS if set(names) == set(pair)), None)
        if pair is not None and name:
            clocks[name] = _seconds(_attribute(get, pair[0]), _attribute(get, pair[1]))
            return
        for part in names:
            inner = f"{name}.{part}" if name else part
            _attributes(
                inner, getattr(value, part), _attribute(get, part), values, clocks, depth + 1
            )


def _names(value: Any) -> list[str]:
    """Of a message's fields, whichever library decoded it."""
    if is_dataclass(value):
        return [field.name for field in fields(value) if not field.name.startswith("_")]
    slots: Sequence[str] = getattr(value, "__slots__", None) or list(vars(value))
    return [name for name in slots if not name.startswith("_")]


def _joints(first: Any, field: str | None) -> Fields:
    if field is None or not getattr(first, field):
        return Fields({}, {})

    def getter(joint: str) -> Getter:
        def get(message: Any) -> Any:
            return dict(zip(message.name, getattr(message, field), strict=False)).get(joint)

        return get

    stamp = _seconds(attrgetter("header.stamp.sec"), attrgetter("header.stamp.nanosec"))
    return Fields({joint: getter(joint) for joint in first.name}, {"header.stamp": stamp})


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
