"""One topic of a recording as columns: of each message, the numbers that the stream asks for."""

import sys
from array import array
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from operator import attrgetter
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.errors import LogError
from twin.recording.formats.array_file import Names, NumberFile, Tables
from twin.recording.formats.topic import Messages, Topic, TopicMessage

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
        self.marks: dict[Names, bytearray] = {}
        """What each row has in some columns (`filled`); empty until a pass has looked."""
        self.last = sys.maxsize
        """The row of the file before which `numbers` ends."""
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

    def filled(self, names: Sequence[str]) -> NDArray[np.uint8]:
        names = tuple(self.find(name) for name in names)
        if not self.marks.setdefault(names, bytearray()):
            self._read(None)
        return np.frombuffer(bytes(self.marks[names]), np.uint8)

    def expect_filled(self, names: Sequence[str]) -> None:
        self.marks.setdefault(tuple(self.find(name) for name in names), bytearray())
        if self not in self._readers:
            self._readers.append(self)

    def only(self, first: int, last: int) -> None:
        self.offset, self.last = first, last

    def numbers(self, names: Sequence[str]) -> Array:
        names = tuple(self.find(name) for name in names)
        if names not in self.tables:
            self._read(names)
        table = self.tables.take(names)
        for index, name in enumerate(names):
            if name in STAMPS and not table[:, index].any():
                raise self.fault(f"{name} is 0 in every message", 'write time = "log_time"')
        return table

    def _read(self, names: Names | None) -> None:
        """Fill that table, and what else any reader of the file expects, in one pass."""
        wanted = {reader: reader.tables.missing() for reader in self._readers}
        if names is not None:
            wanted[self] = [names, *wanted.get(self, [])]
        fillings = [
            _Filling(reader, tables)
            for reader, tables in wanted.items()
            if tables or not all(reader.marks.values())
        ]
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

    def getter(self, name: str) -> Callable[[TopicMessage, Any], Any]:
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
        self._marks = [
            ([file.getter(name) for name in names], marks)
            for names, marks in file.marks.items()
            if not marks
        ]
        self._columns = [
            (name, file.getter(name), rows) for names, rows in self.tables.items() for name in names
        ]

    def add(self, message: TopicMessage, decoded: Any) -> None:
        """Append what a message has in each column; NaN where it has nothing."""
        kept = self.file.offset <= self.count < self.file.last
        for name, get, rows in self._columns if kept else ():
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
        for getters, marks in self._marks:
            marks.append(_filled_in([get(message, decoded) for get in getters]))
        self.count += 1


def _filled_in(values: Sequence[Any]) -> int:
    """As `array_file.filled_in`, of a message."""
    numbers = [value for value in values if value is not None and value == value]
    return 0 if not numbers else 1 + any(value != 0 for value in numbers)
