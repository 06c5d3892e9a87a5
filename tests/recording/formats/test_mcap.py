"""MCAP: ROS 2 messages by the stream's unit, JSON and Protobuf by dotted names, cut files."""

import io
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory, timestamp_pb2
from mcap.writer import CompressionType, Writer
from mcap_ros2.writer import Writer as Ros2Writer

from twin.errors import LogError

RULE = "\n" + "=" * 80 + "\n"
HEADER = "MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id"
TIME = "MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec"
QUATERNION = "MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w"
VECTOR = "MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z"
TYPES = {
    "sensor_msgs/msg/Imu": RULE.join(
        [
            "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\n"
            "float64[9] orientation_covariance\ngeometry_msgs/Vector3 angular_velocity\n"
            "float64[9] angular_velocity_covariance\n"
            "geometry_msgs/Vector3 linear_acceleration\n"
            "float64[9] linear_acceleration_covariance",
            HEADER,
            TIME,
            QUATERNION,
            VECTOR,
        ]
    ),
    "geometry_msgs/msg/QuaternionStamped": RULE.join(
        ["std_msgs/Header header\ngeometry_msgs/Quaternion quaternion", HEADER, TIME, QUATERNION]
    ),
    "sensor_msgs/msg/JointState": RULE.join(
        [
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\n"
            "float64[] effort",
            HEADER,
            TIME,
        ]
    ),
    "std_msgs/msg/String": "string data",
}
START = 1_700_000_000
NONE = [0.0] * 9


def stamped(index: int) -> dict[str, object]:
    return {"stamp": {"sec": START + index // 100, "nanosec": index % 100 * 10**7}, "frame_id": "b"}


def imu(index: int) -> dict[str, object]:
    return {
        "header": stamped(index),
        "orientation": {"w": 0.8, "x": 0.6, "y": 0.0, "z": 0.0},
        "orientation_covariance": NONE,
        "angular_velocity": {"x": index, "y": 2.0, "z": 3.0},
        "angular_velocity_covariance": NONE,
        "linear_acceleration": {"x": 0.0, "y": 0.0, "z": 9.81},
        "linear_acceleration_covariance": NONE,
    }


def joints(index: int) -> dict[str, object]:
    return {
        "header": stamped(index),
        "name": ["w1", "w2"] if index % 2 else ["w2", "w1"],
        "position": [0.1, 0.2],
        "velocity": [1.0, 2.0] if index % 2 else [2.0, 1.0],
        "effort": [],
    }


def write_ros2(
    path: Path, topics: Mapping[str, tuple[str, Callable[[int], object]]], count: int = 50
) -> None:
    with path.open("wb") as file:
        writer = Ros2Writer(file, chunk_size=4000)
        schemas = {kind: writer.register_msgdef(kind, TYPES[kind]) for kind, _ in topics.values()}
        for index in range(count):
            logged = START * 10**9 + index * 10**7 + 2 * 10**6
            for topic, (kind, message) in topics.items():
                writer.write_message(topic, schemas[kind], message(index), log_time=logged)
        writer.finish()


def write_json(path: Path, messages: Sequence[object], topic: str = "/g") -> None:
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(topic, "json", 0)
        for index, message in enumerate(messages):
            data = message if isinstance(message, bytes) else json.dumps(message).encode()
            stamp = index * 10**7
            writer.add_message(channel, log_time=stamp, publish_time=stamp, data=data)
        writer.finish()


@pytest.fixture
def ros2(tmp_path: Path) -> Path:
    path = tmp_path / "a.mcap"
    write_ros2(
        path,
        {
            "/imu": ("sensor_msgs/msg/Imu", imu),
            "/vicon": (
                "geometry_msgs/msg/QuaternionStamped",
                lambda i: {
                    "header": stamped(i),
                    "quaternion": {"w": 0.6, "x": 0.0, "y": 0.8, "z": 0.0},
                },
            ),
            "/wheels": ("sensor_msgs/msg/JointState", joints),
            "/log": ("std_msgs/msg/String", lambda i: {"data": "hello"}),
        },
    )
    return path


def entry(stream: str, topic: str, more: str = "") -> str:
    return f'[streams.{stream}]\nfile = "a.mcap"\ntopic = "{topic}"\n{more}'


@pytest.mark.usefixtures("ros2")
def test_an_imu_gives_each_stream_its_field_at_the_stamps_of_its_header(log_of):
    log = log_of(entry("gyro", "/imu") + entry("accelerometer", "/imu") + entry("attitude", "/imu"))
    np.testing.assert_array_equal(log["gyro"].value[:, 0], np.arange(50))
    np.testing.assert_array_equal(log["gyro"].value[:, 1:], [[2.0, 3.0]] * 50)
    np.testing.assert_array_equal(log["accelerometer"].value[0], [0.0, 0.0, 9.81])
    np.testing.assert_allclose(log["attitude"].value[0], [0.8, 0.6, 0.0, 0.0])
    np.testing.assert_allclose(log["gyro"].time, np.arange(50) / 100.0, atol=1e-6)
    assert log.provenance["time_origin"] == START


@pytest.mark.usefixtures("ros2")
def test_the_recorders_clock_can_be_asked_for(log_of):
    log = log_of(entry("gyro", "/imu", 'time = "log_time"\n'))
    assert log.provenance["time_origin"] == pytest.approx(START + 0.002, abs=1e-6)


@pytest.mark.usefixtures("ros2")
@pytest.mark.parametrize("layout", ["wxyz", "xyzw"])
def test_a_quaternions_parts_are_found_by_their_names(log_of, layout: str):
    log = log_of(entry("attitude", "/vicon", f'format = "{layout}"\ndirection = "world_to_body"\n'))
    np.testing.assert_allclose(log["attitude"].value[3], [0.6, 0.0, -0.8, 0.0])


@pytest.mark.usefixtures("ros2")
def test_joints_are_found_by_name_in_the_list_of_the_streams_unit(log_of):
    log = log_of(entry("wheel_speed", "/wheels", 'columns = ["w1", "w2"]\n'))
    assert log["wheel_speed"].columns == ("w1", "w2")
    np.testing.assert_array_equal(log["wheel_speed"].value, [[1.0, 2.0]] * 50)
    assert log_of(entry("joint_angle", "/wheels"))["joint_angle"].columns == ("w2", "w1")


@pytest.mark.usefixtures("ros2")
@pytest.mark.parametrize(
    ("toml", "sentence"),
    [
        (
            entry("gyro", "/gyro"),
            "a.mcap: has no topic '/gyro'; name one of its topics in `topic`: /imu "
            "(sensor_msgs/Imu), /log (std_msgs/String), /vicon (geometry_msgs/QuaternionStamped), "
            "/wheels (sensor_msgs/JointState)",
        ),
        (
            entry("gyro", "/log"),
            "a.mcap: std_msgs/String on /log holds no number; name another `topic`",
        ),
        (
            '[streams.gyro]\nfile = "a.mcap"\n',
            "a.mcap: holds several topics; name one of its topics in `topic`: /imu "
            "(sensor_msgs/Imu), /log (std_msgs/String), /vicon (geometry_msgs/QuaternionStamped), "
            "/wheels (sensor_msgs/JointState)",
        ),
        (
            entry("gyro", "/vicon"),
            "log.toml:3: streams.gyro.file gives gyro no column beside 'header.stamp', 'log_time', "
            "'publish_time', 'quaternion.x', 'quaternion.y', 'quaternion.z', 'quaternion.w' for x, "
            "y, z; give `rate` if the file has no times, else list the right ones in `columns`, "
            "and in `axes` which of the stream they are",
        ),
        (
            entry("command_wheel_torque", "/wheels"),
            "a.mcap: sensor_msgs/JointState on /wheels holds no number in N m; "
            "name another `topic`",
        ),
        (
            entry("wheel_speed", "/wheels", 'columns = ["w3"]\n'),
            "a.mcap: no column named 'w3' (did you mean 'w2', 'w1'?); name one of its columns",
        ),
        (
            entry("gyro", "/imu", 'time_unit = "ns"\n'),
            "log.toml:5: streams.gyro.time_unit is given, but header.stamp is in seconds by its "
            "type; remove it",
        ),
    ],
)
def test_what_a_file_does_not_hold_is_refused_with_what_it_does(complaint, toml, sentence):
    assert complaint(toml) == sentence


def test_an_imu_that_says_it_has_no_attitude_is_refused(complaint, tmp_path: Path):
    unknown = {"orientation_covariance": [-1.0, *NONE[1:]]}
    write_ros2(tmp_path / "a.mcap", {"/imu": ("sensor_msgs/msg/Imu", lambda i: imu(i) | unknown)})
    assert complaint(entry("attitude", "/imu")) == (
        "a.mcap: /imu says by its covariance that it has no orientation; name another `topic`"
    )


def test_headers_without_a_stamp_are_refused(complaint, log_of, tmp_path: Path):
    bare = {"header": {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": ""}}
    write_ros2(tmp_path / "a.mcap", {"/imu": ("sensor_msgs/msg/Imu", lambda i: imu(i) | bare)})
    assert complaint(entry("gyro", "/imu")) == (
        'a.mcap: header.stamp is 0 in every message; write time = "log_time"'
    )


def test_json_gives_columns_by_dotted_names(log_of, tmp_path: Path):
    rest = {"list": [7, 8], "id": "a"}
    messages = [{"t": i, "rate": {"x": i, "y": 1, "z": 2}, **rest} for i in range(3)]
    write_json(tmp_path / "a.mcap", messages)
    columns = 'columns = ["rate.x", "list.1", "rate.z"]\n'
    log = log_of(entry("gyro", "/g", columns))
    np.testing.assert_array_equal(log["gyro"].value, [[0, 8, 2], [1, 8, 2], [2, 8, 2]])
    np.testing.assert_allclose(log["gyro"].time, [0.0, 0.01, 0.02])
    log = log_of(entry("gyro", "/g", columns + 'time = "t"\ntime_unit = "ms"\n'))
    np.testing.assert_allclose(log["gyro"].time, [0.0, 0.001, 0.002])


def test_json_without_a_sample_is_left_out_and_counted(log_of, tmp_path: Path):
    write_json(tmp_path / "a.mcap", [{"x": 1.0}, {"x": None}, {}, {"x": 2.0}])
    log = log_of(entry("gyro", "/g", 'axes = ["x"]\n'))
    np.testing.assert_array_equal(log["gyro"].value[:, 0], [1.0, 2.0])
    assert log.repairs == ("gyro (a.mcap): 2 rows without a number left out",)


@pytest.mark.parametrize(
    ("messages", "sentence"),
    [
        (
            [{"x": 1.0}, {"x": "high"}],
            "a.mcap: column 'x' holds 'high', which is no finite number (message 2 on /g); "
            "write the number, or name other `columns`",
        ),
        (
            [{"x": 1.0}, {"x": 10**310}],
            f"a.mcap: column 'x' holds {10**310}, which is no finite number (message 2 on /g); "
            "write the number, or name other `columns`",
        ),
        ([{"name": "a"}], "a.mcap: on /g holds no number; name another `topic`"),
        (
            [{"x": 1.0}, b"{"],
            "a.mcap: message 2 on /g cannot be decoded (Expecting property name enclosed in double "
            "quotes: line 1 column 2 (char 1)); record it again",
        ),
        ([], "a.mcap: has no whole message on /g; record it again"),
    ],
)
def test_json_that_holds_no_numbers_is_refused(complaint, tmp_path: Path, messages, sentence):
    write_json(tmp_path / "a.mcap", messages)
    assert complaint(entry("gyro", "/g", 'axes = ["x"]\n')) == sentence


def test_protobuf_gives_columns_by_dotted_names_from_its_own_schema(log_of, tmp_path: Path):
    file = descriptor_pb2.FileDescriptorProto(name="lab.proto", package="lab", syntax="proto3")
    file.dependency.append("google/protobuf/timestamp.proto")
    vector = file.message_type.add(name="Vector")
    for number, name in enumerate("xyz", 1):
        vector.field.add(name=name, number=number, type=1, label=1)
    sample = file.message_type.add(name="Sample")
    nested = {"type": 11, "label": 1}
    sample.field.add(name="stamp", number=1, type_name=".google.protobuf.Timestamp", **nested)
    sample.field.add(name="rate", number=2, type_name=".lab.Vector", **nested)
    sample.field.add(name="label", number=3, type=9, label=1)
    sample.field.add(name="wheels", number=4, type=2, label=3)
    pool = descriptor_pool.DescriptorPool()
    pool.AddSerializedFile(timestamp_pb2.DESCRIPTOR.serialized_pb)
    pool.Add(file)
    make = message_factory.GetMessageClass(pool.FindMessageTypeByName("lab.Sample"))
    known = descriptor_pb2.FileDescriptorSet()
    known.file.add().ParseFromString(timestamp_pb2.DESCRIPTOR.serialized_pb)
    known.file.append(file)
    with (tmp_path / "a.mcap").open("wb") as out:
        writer = Writer(out)
        writer.start()
        schema = writer.register_schema("lab.Sample", "protobuf", known.SerializeToString())
        channel = writer.register_channel("/p", "protobuf", schema)
        for i in range(3):
            message = make(label="a", wheels=[1.0, 2.0])
            message.stamp.seconds, message.stamp.nanos = 5 + i, 500_000_000
            message.rate.x, message.rate.y = float(i), 4.0
            data = message.SerializeToString()
            writer.add_message(channel, log_time=i, publish_time=i, data=data)
        writer.finish()
    log = log_of(
        entry("gyro", "/p", 'columns = ["rate.x", "rate.y", "rate.z"]\ntime = "stamp"\n')
        + entry("wheel_speed", "/p", 'columns = ["wheels.1"]\ntime = "stamp"\n')
    )
    np.testing.assert_array_equal(log["gyro"].value, [[0, 4, 0], [1, 4, 0], [2, 4, 0]])
    np.testing.assert_array_equal(log["gyro"].time, [5.5, 6.5, 7.5])
    np.testing.assert_array_equal(log["wheel_speed"].value[:, 0], 2.0)


def test_an_unknown_encoding_is_refused_with_its_name(complaint, tmp_path: Path):
    with (tmp_path / "a.mcap").open("wb") as out:
        writer = Writer(out)
        writer.start()
        schema = writer.register_schema("lab/Blob", "flatbuffer", b"")
        writer.register_channel("/blob", "flatbuffer", schema)
        writer.finish()
    assert complaint(entry("gyro", "/blob")) == (
        "a.mcap: topic /blob is of type flatbuffer lab/Blob, which is not read; name one of its "
        "topics in `topic`: /blob (flatbuffer lab/Blob)"
    )


def test_a_damaged_schema_is_refused(complaint, tmp_path: Path):
    with (tmp_path / "a.mcap").open("wb") as out:
        writer = Writer(out)
        writer.start()
        schema = writer.register_schema("lab.Sample", "protobuf", b"\xff")
        writer.register_channel("/p", "protobuf", schema)
        writer.finish()
    said = complaint(entry("gyro", "/p"))
    assert said.startswith("a.mcap: has a damaged schema for /p (")
    assert said.endswith("); copy it again from where it was recorded")


def test_of_a_file_cut_short_what_is_whole_is_read_and_said(log_of, ros2: Path):
    content = ros2.read_bytes()
    ros2.write_bytes(content[: len(content) // 2])
    log = log_of(entry("gyro", "/imu") + entry("accelerometer", "/imu"))
    rows = len(log["gyro"])
    assert 10 < rows < 50
    np.testing.assert_array_equal(log["gyro"].value[:, 0], np.arange(rows))
    assert log.repairs == (
        f"a.mcap was cut short or is damaged; {rows} whole messages on /imu are here",
    )


def test_a_file_cut_before_its_first_message_is_refused(complaint, ros2: Path):
    ros2.write_bytes(ros2.read_bytes()[:150])
    assert complaint(entry("gyro", "/imu")) == (
        "a.mcap: is cut short before its first message; copy it again from where it was recorded"
    )


@pytest.mark.parametrize("content", [b"t,x\n0,1\n2,3\n4,5\n", bytes(4000)])
def test_what_is_no_mcap_file_is_refused(complaint, tmp_path: Path, content: bytes):
    (tmp_path / "a.mcap").write_bytes(content)
    assert complaint(entry("gyro", "/imu")) == (
        "a.mcap: is no MCAP file; record or export it as MCAP"
    )


def test_no_cut_and_no_flipped_byte_gives_a_wrong_number_or_a_traceback(log_of, ros2: Path):
    content = ros2.read_bytes()
    generator = np.random.default_rng(3)
    toml = entry("gyro", "/imu")
    damaged = [content[:size] for size in generator.integers(0, len(content), 40)]
    for place in generator.integers(0, len(content), 150):
        flipped = bytearray(content)
        flipped[place] ^= 1 << int(generator.integers(8))
        damaged.append(bytes(flipped))
    read = 0
    for number, damage in enumerate(damaged):
        ros2.write_bytes(damage)
        try:
            log = log_of(toml)
        except LogError:
            continue
        rows = len(log["gyro"])
        np.testing.assert_array_equal(log["gyro"].value[:, 0], np.arange(rows))
        assert rows == 50 or log.repairs, f"{number}: rows are missing, and nobody says so"
        read += 1
    assert read > 50


def test_a_compressed_and_an_uncompressed_file_read_alike(log_of, tmp_path: Path):
    values = []
    for compression in CompressionType:
        buffer = io.BytesIO()
        writer = Writer(buffer, compression=compression)
        writer.start()
        channel = writer.register_channel("/g", "json", 0)
        writer.add_message(channel, log_time=1, publish_time=1, data=b'{"x": 0.1}')
        writer.finish()
        (tmp_path / "a.mcap").write_bytes(buffer.getvalue())
        values.append(log_of(entry("gyro", "/g", 'axes = ["x"]\n'))["gyro"].value.tolist())
    assert values == [[[0.1]]] * 3
