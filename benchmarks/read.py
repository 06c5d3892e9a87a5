"""How long a large log takes to read, and in how much memory: text, MCAP and ROS 1 bag.

`python -m benchmarks read --size 2GB --formats csv mcap bag`. Each file is written, read by a
process of its own, and deleted. The text has 30 columns, of which a gyro and an attitude take 7
beside the time; the bags hold nothing but an Imu and a pose at 200 Hz, uncompressed: the most
messages that a file of that size can have.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measure import table

SIZE = "200MB"
"""Of a file, where no other is asked for."""
UNITS = {"MB": 1e6, "GB": 1e9}
TARGET = 1e9
"""Memory that reading 2 GB may take [B]."""
BLOCK = 10_000
"""Rows of text that come again and again, each time with their own times."""
COLUMNS = ("t", *(f"w{axis}" for axis in "xyz"), *(f"q{part}" for part in "wxyz"))
OTHERS = 22
"""Columns that no stream takes."""
IMU, POSE = "sensor_msgs/msg/Imu", "geometry_msgs/msg/PoseStamped"
TOPICS = {"/imu": IMU, "/pose": POSE}
STEP = 5_000_000
"""Between two messages on a topic [ns]."""
BEGAN = 1_700_000_000
"""Of the bags' clock [s]."""

TEXT_LOG = """
[streams.gyro]
file = "log.csv"
columns = ["wx", "wy", "wz"]
unit = "deg/s"
[streams.attitude]
file = "log.csv"
columns = ["qw", "qx", "qy", "qz"]
"""
BAG_LOG = """
[streams.gyro]
file = "log.ENDING"
topic = "/imu"
[streams.accelerometer]
file = "log.ENDING"
topic = "/imu"
[streams.attitude]
file = "log.ENDING"
topic = "/pose"
"""
CODE = """
import json, sys, time
from twin.recording import open_log
start = time.perf_counter()
log = open_log(sys.argv[1])
took = time.perf_counter() - start
peak = open("/proc/self/status").read().split("VmHWM:")[1].split()[0]
kept = sum(one.time.nbytes + one.value.nbytes for one in log.values())
rows = {name: len(one) for name, one in log.items()}
print(json.dumps({"seconds": took, "peak": 1024 * int(peak), "kept": kept, "rows": rows}))
"""


def write_csv(path: Path, size: float) -> None:
    """Rows at 1 kHz, up to that size [B]."""
    draw = np.random.default_rng(0)
    attitude = draw.normal(size=(BLOCK, 4))
    attitude /= np.linalg.norm(attitude, axis=1)[:, None]
    others = draw.normal(size=(BLOCK, OTHERS))
    values = np.hstack([draw.normal(size=(BLOCK, 3)), attitude, others])
    bodies = [",".join(f"{value:.6f}" for value in row) for row in values]
    names = (*COLUMNS, *(f"u{index}" for index in range(OTHERS)))
    with path.open("w", encoding="ascii") as file:
        file.write(",".join(names) + "\n")
        first = 0
        while file.tell() < size:
            rows = enumerate(bodies, first)
            file.write("".join(f"{row * 1e-3:.3f},{body}\n" for row, body in rows))
            first += BLOCK


def write_mcap(path: Path, size: float) -> None:
    """Messages of ROS 2, up to that size [B]."""
    from mcap.writer import CompressionType, Writer
    from rosbags.typesys import Stores, get_typestore

    types: Any = get_typestore(Stores.ROS2_JAZZY)
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        writer.start("ros2")
        channels = dict[str, int]()
        for topic, kind in TOPICS.items():
            text, _ = types.generate_msgdef(kind, ros_version=2)
            schema = writer.register_schema(kind, "ros2msg", text.encode())
            channels[topic] = writer.register_channel(topic, "cdr", schema)
        for topic, stamp, data in _messages(types, types.serialize_cdr, head=4):
            writer.add_message(channels[topic], stamp, data, stamp)
            if file.tell() >= size:
                break
        writer.finish()


def write_bag(path: Path, size: float) -> None:
    """Messages of ROS 1, up to that size [B]."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    types: Any = get_typestore(Stores.ROS1_NOETIC)
    with Writer(path) as writer:
        connections = {
            topic: writer.add_connection(topic, kind, typestore=types)
            for topic, kind in TOPICS.items()
        }
        for number, (topic, stamp, data) in enumerate(
            _messages(types, types.serialize_ros1, head=4)
        ):
            writer.write(connections[topic], stamp, data)
            if number % BLOCK == 0 and path.stat().st_size >= size:
                break


def _messages(
    types: Any, serialize: Callable[[Any, str], memoryview], head: int
) -> Iterator[tuple[str, int, bytes]]:
    """Topic, time [ns] and bytes of messages without an end, which differ in their stamps.

    Args:
        types: the store of the messages' types.
        serialize: a message of a type -> its bytes.
        head: bytes before the stamp.
    """
    kinds = types.types

    def made(kind: str, **parts: Any) -> Any:
        return kinds[kind](**parts)

    words = {"seq": 0} if "seq" in kinds["std_msgs/msg/Header"].__dataclass_fields__ else {}
    stamp = made("builtin_interfaces/msg/Time", sec=0, nanosec=0)
    header = made("std_msgs/msg/Header", stamp=stamp, frame_id="base", **words)
    turn = made("geometry_msgs/msg/Quaternion", x=0.0, y=0.8, z=0.0, w=0.6)
    vector = made("geometry_msgs/msg/Vector3", x=0.1, y=0.2, z=9.8)
    place = made("geometry_msgs/msg/Point", x=0.0, y=0.1, z=1.0)
    unknown = np.zeros(9)
    imu = made(
        IMU,
        header=header,
        orientation=turn,
        orientation_covariance=unknown,
        angular_velocity=vector,
        angular_velocity_covariance=unknown,
        linear_acceleration=vector,
        linear_acceleration_covariance=unknown,
    )
    pose = made(
        POSE, header=header, pose=made("geometry_msgs/msg/Pose", position=place, orientation=turn)
    )
    parts = {
        topic: (bytes(data[:head]), bytes(data[head + 8 :]))
        for topic, data in (
            ("/imu", serialize(imu, IMU)),
            ("/pose", serialize(pose, POSE)),
        )
    }
    number = 0
    while True:
        time = BEGAN * 10**9 + STEP * number
        seconds, rest = divmod(time, 10**9)
        stamped = seconds.to_bytes(4, "little") + rest.to_bytes(4, "little")
        for topic, (before, after) in parts.items():
            yield topic, time, before + stamped + after
        number += 1


WRITERS = {"csv": write_csv, "mcap": write_mcap, "bag": write_bag}


def measured(ending: str, size: float, folder: Path) -> dict[str, Any]:
    """Write a file of that size [B] into a folder, read it in a process of its own."""
    start = time.perf_counter()
    path = folder / f"log.{ending}"
    WRITERS[ending](path, size)
    text = TEXT_LOG if ending == "csv" else BAG_LOG.replace("ENDING", ending)
    (folder / "log.toml").write_text(text, encoding="utf-8")
    written = time.perf_counter() - start
    done = subprocess.run([sys.executable, "-c", CODE, str(folder)], capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(done.stderr)
    return {**json.loads(done.stdout), "size": path.stat().st_size, "written": written}


def run(words: Sequence[str] = ()) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks read")
    parser.add_argument("--size", type=_bytes, default=SIZE, help="of each file, as 2GB or 300MB")
    parser.add_argument("--formats", nargs="+", choices=WRITERS, default=list(WRITERS))
    asked = parser.parse_args(words)
    rows: list[tuple[str, ...]] = []
    for ending in asked.formats:
        with tempfile.TemporaryDirectory() as place:
            free = shutil.disk_usage(place).free
            if free < 1.5 * asked.size:
                raise SystemExit(f"{place} has {free / 1e9:.1f} GB left: set TMPDIR to another")
            item = measured(ending, asked.size, Path(place))
        rows.append(
            (
                ending,
                f"{item['size'] / 1e6:.0f} MB",
                f"{sum(item['rows'].values()):,}",
                f"{item['seconds']:.0f} s",
                f"{item['size'] / 1e6 / item['seconds']:.1f}",
                f"{item['kept'] / 1e6:.0f} MB",
                f"{item['peak'] / 1e6:.0f} MB",
            )
        )
    table(
        (
            "file",
            "size",
            "rows of its streams",
            "read in",
            "MB a second",
            "numbers kept",
            f"memory at most (2 GB: <= {TARGET / 1e6:.0f} MB)",
        ),
        rows,
    )


def _bytes(text: str) -> float:
    result = re.fullmatch(r"(\d+(?:\.\d+)?) ?(MB|GB)", text)
    if result is None:
        raise argparse.ArgumentTypeError(f"{text!r} is no size; say 2GB or 300MB")
    return float(result[1]) * UNITS[result[2]]
