"""One motion as the files that each maker's program, logger or library would have made of it."""

import io
import json
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from twin import rotation

RATE = 50.0
"""Of every stream [Hz]."""
DEG, G = np.pi / 180.0, 9.80665
EPOCH = 1_764_000_000.0
"""Of clocks that count since 1970 [s]."""
LIMIT = 60.0
"""Of one verb on one file, in seconds of the processor: others may use the computer, too."""


@dataclass(frozen=True)
class Motion:
    """What was true: rows (m,) of each stream, SI, in the twin's frames."""

    time: np.ndarray
    attitude: np.ndarray
    gyro: np.ndarray
    accelerometer: np.ndarray
    magnetometer: np.ndarray
    position: np.ndarray

    @property
    def euler(self) -> np.ndarray:
        """Yaw, pitch, roll [rad]."""
        return np.unwrap(rotation.to_euler_zyx(self.attitude), axis=0)


def motion(seed: int, seconds: float = 20.0) -> Motion:
    """A body that turns to and fro about all its axes, with a little noise in every sensor."""
    draw = np.random.default_rng(seed)
    time = np.arange(int(seconds * RATE)) / RATE
    phase, speed = draw.uniform(0.0, 6.28, (2, 3)), draw.uniform(0.25, 0.6, 3)
    start = draw.uniform(-1.5, 1.5)
    yaw, pitch, roll = (
        draw.uniform(0.2, 0.4) * np.sin(speed[i] * time + phase[0, i])
        + 0.1 * np.sin(2.3 * speed[i] * time + phase[1, i])
        for i in range(3)
    )
    attitude = rotation.from_euler_zyx(yaw + start, pitch, roll)
    turn = rotation.multiply(rotation.conjugate(attitude[:-1]), attitude[1:])
    rate = rotation.to_rotation_vector(turn) * RATE
    rate = np.concatenate([rate[:1], 0.5 * (rate[1:] + rate[:-1]), rate[-1:]])
    back = rotation.conjugate(attitude)
    field = np.array([2.1e-5, 0.3e-5, -4.2e-5])
    return Motion(
        time=time,
        attitude=attitude,
        gyro=rate + draw.normal(0.0, 1e-3, rate.shape),
        accelerometer=rotation.rotate(back, np.broadcast_to([0.0, 0.0, 9.81], rate.shape))
        + draw.normal(0.0, 0.01, rate.shape),
        magnetometer=rotation.rotate(back, np.broadcast_to(field, rate.shape))
        + draw.normal(0.0, 1e-7, rate.shape),
        position=0.1 * np.sin(0.2 * time[:, None] + np.arange(3)),
    )


@dataclass(frozen=True)
class Maker:
    """A layout of a file."""

    name: str
    file: str
    write: Callable[[Path, Motion], None]
    streams: tuple[str, ...]
    """That `twin import` finds in it."""
    digits: float = 1e-6
    """Rounding of the file, in the streams' SI units."""
    refused: str = ""
    """A part of the sentence that it is refused with; empty where it is opened."""


def _text(rows: list[list[str]], separator: str = ",", end: str = "\n") -> str:
    return "".join(separator.join(row) + end for row in rows)


def _numbers(*columns: np.ndarray, digits: int = 9) -> list[list[str]]:
    table = np.column_stack(columns)
    return [[f"{x:.{digits}f}" for x in row] for row in table]


def _gyro_acc(m: Motion) -> list[list[str]]:
    return _numbers(m.time, m.gyro, m.accelerometer)


NAMES = ["t", "gyro_x", "gyro_y", "gyro_z", "acc_x", "acc_y", "acc_z"]


def _plain(path: Path, m: Motion) -> None:
    path.write_text(_text([NAMES, *_gyro_acc(m)]))


def _semicolons(path: Path, m: Motion) -> None:
    rows = [[cell.replace(".", ",") for cell in row] for row in _gyro_acc(m)]
    path.write_text(_text([NAMES, *rows], ";"))


def _tabs(path: Path, m: Motion) -> None:
    path.write_text(_text([NAMES, *_gyro_acc(m)], "\t"))


def _spaces(path: Path, m: Motion) -> None:
    rows = [NAMES, *_gyro_acc(m)]
    path.write_text("".join("".join(f"{cell:>16}" for cell in row) + "\n" for row in rows))


def _units_below(path: Path, m: Motion) -> None:
    units = ["s", "deg/s", "deg/s", "deg/s", "g", "g", "g"]
    rows = _numbers(m.time, m.gyro / DEG, m.accelerometer / G)
    path.write_text(_text([NAMES, units, *rows]))


def _units_in_brackets(path: Path, m: Motion) -> None:
    names = [
        "time [ms]",
        *(f"gyro_{a} [deg/s]" for a in "xyz"),
        *(f"acc_{a} [m/s^2]" for a in "xyz"),
    ]
    rows = _numbers(1e3 * m.time, m.gyro / DEG, m.accelerometer)
    path.write_text(_text([names, *rows]))


def _spelt_otherwise(path: Path, m: Motion) -> None:
    names = [
        "Time (msec)",
        *(f"Gyro {a} (DPS)" for a in "XYZ"),
        *(f"Accel {a} (milli-g)" for a in "XYZ"),
        *(f"Mag {a} (Gauss)" for a in "XYZ"),
    ]
    rows = _numbers(1e3 * m.time, m.gyro / DEG, m.accelerometer / G * 1e3, m.magnetometer / 1e-4)
    path.write_text(_text([names, *rows]))


def _comments(path: Path, m: Motion) -> None:
    head = "# bench 2, third run\n# operator: A. B.\n\n"
    path.write_text(head + _text([NAMES, *_gyro_acc(m)]))


def _savetxt(path: Path, m: Motion) -> None:
    np.savetxt(
        path, np.column_stack([m.time, m.gyro, m.accelerometer]), header=" ".join(NAMES), fmt="%.9f"
    )


def _dates(path: Path, m: Motion) -> None:
    start = np.datetime64("2026-02-03T10:00:00", "us")
    stamps = start + np.round(1e6 * m.time).astype("timedelta64[us]")
    rows = [[str(s), *row[1:]] for s, row in zip(stamps, _gyro_acc(m), strict=True)]
    path.write_text(_text([["timestamp", *NAMES[1:]], *rows]))


def _pandas(path: Path, m: Motion) -> None:
    start = np.datetime64("2026-02-03T10:00:00", "us")
    stamps = start + np.round(1e6 * m.time).astype("timedelta64[us]")
    rows = [
        [str(i), f"{str(s).replace('T', ' ')}+00:00", *row[1:]]
        for i, (s, row) in enumerate(zip(stamps, _gyro_acc(m), strict=True))
    ]
    path.write_text(_text([["", "time", *NAMES[1:]], *rows]))


def _microseconds(path: Path, m: Motion) -> None:
    rows = _numbers(np.round(1e6 * (EPOCH + m.time)), m.gyro, m.accelerometer)
    path.write_text(_text([["timestamp_us", *NAMES[1:]], *rows]))


def _utf16(path: Path, m: Motion) -> None:
    path.write_bytes(_text([NAMES, *_gyro_acc(m)], "\t").encode("utf-16"))


def _windows(path: Path, m: Motion) -> None:
    names = ["Zeit [s]", *(f"gyro_{a} [°/s]" for a in "xyz"), *(f"acc_{a} [m/s²]" for a in "xyz")]
    rows = [
        [cell.replace(".", ",") for cell in row]
        for row in _numbers(m.time, m.gyro / DEG, m.accelerometer)
    ]
    path.write_bytes(_text([names, *rows], ";", "\r\n").encode("cp1252"))


def _ended(path: Path, m: Motion) -> None:
    rows = [NAMES, *_gyro_acc(m)]
    path.write_text("".join(",".join(row) + ",\n" for row in rows))


def _oscilloscope(path: Path, m: Motion) -> None:
    path.write_text("\n" + _text([NAMES, *_gyro_acc(m)]))


def _excel_csv(path: Path, m: Motion) -> None:
    path.write_text("sep=;\n" + _text([NAMES, *_gyro_acc(m)], ";"))


def _indexed(path: Path, m: Motion) -> None:
    rows = [[f"{i}", *row] for i, row in enumerate(_gyro_acc(m))]
    path.write_text(_text([["Step", "Control_Time", *NAMES[1:]], *rows]))


def _quaternion_csv(path: Path, m: Motion) -> None:
    rows = _numbers(m.time, m.attitude, m.gyro)
    path.write_text(_text([["time", "qw", "qx", "qy", "qz", "wx", "wy", "wz"], *rows]))


def _scalar_last(path: Path, m: Motion) -> None:
    rows = _numbers(m.time, m.attitude[:, [1, 2, 3, 0]], m.gyro)
    path.write_text(_text([["time", "qx", "qy", "qz", "qw", "wx", "wy", "wz"], *rows]))


def _euler_csv(path: Path, m: Motion) -> None:
    names = ["Time [s]", "Yaw [deg]", "Pitch [deg]", "Roll [deg]"]
    names += [f"Gyro {a} [deg/s]" for a in "XYZ"] + [f"Accel {a} [m/s^2]" for a in "XYZ"]
    path.write_text(_text([names, *_numbers(m.time, m.euler / DEG, m.gyro / DEG, m.accelerometer)]))


def _bosch(path: Path, m: Motion) -> None:
    names = ["timestamp(ns)", *(f"gyr_{a}(dps)" for a in "xyz"), *(f"acc_{a}(g)" for a in "xyz")]
    rows = _numbers(np.round(1e9 * m.time), m.gyro / DEG, m.accelerometer / G)
    path.write_text(_text([names, *rows], ";"))


def _serial(path: Path, m: Motion) -> None:
    names = ["millis", "ax", "ay", "az", "gx", "gy", "gz"]
    rows = _numbers(np.round(1e3 * m.time), m.accelerometer, m.gyro)
    path.write_text("boot ok\nsensor ready\n" + _text([names, *rows], " "))


def _fusion(path: Path, m: Motion) -> None:
    names = ["Time (s)", *(f"Gyroscope {a} (deg/s)" for a in "XYZ")]
    names += [f"Accelerometer {a} (g)" for a in "XYZ"] + [f"Magnetometer {a} (uT)" for a in "XYZ"]
    rows = _numbers(m.time, m.gyro / DEG, m.accelerometer / G, m.magnetometer * 1e6)
    path.write_text(_text([names, *rows]))


def _motive_rows(m: Motion, bodies: list[str], metres: bool) -> list[list[str]]:
    unit = "Meters" if metres else "Millimeters"
    first = [
        *("Format Version", "1.23", "Take Name", "Take 1", "Take Notes", ""),
        *("Capture Frame Rate", f"{RATE:.6f}", "Export Frame Rate", f"{RATE:.6f}"),
        *("Capture Start Time", "2026-02-03 10.00.00.000 AM", "Capture Start Frame", "0"),
        *("Total Frames in Take", str(len(m.time)), "Total Exported Frames", str(len(m.time))),
        *("Rotation Type", "Quaternion", "Length Units", unit, "Coordinate Space", "Global"),
    ]
    parts = ["X", "Y", "Z", "W", "X", "Y", "Z", ""]
    kinds = ["Rotation"] * 4 + ["Position"] * 3 + ["Mean Marker Error"]
    # Motive has y up: its x, y, z are our x, z, -y
    w, x, y, z = m.attitude.T
    px, py, pz = m.position.T * (1.0 if metres else 1e3)
    body = [x, z, -y, w, px, pz, -py, np.full(len(w), 0.1)]
    count = len(bodies)
    rows = _numbers(m.time, *body * count, digits=6)
    return [
        first,
        [],
        ["", "Type", *["Rigid Body"] * 8 * count],
        ["", "Name", *(name for name in bodies for _ in range(8))],
        ["", "ID", *(f"3D3E{i:04d}A98BC" for i, _ in enumerate(bodies) for _ in range(8))],
        ["", "", *kinds * count],
        ["Frame", "Time (Seconds)", *parts * count],
        *([str(i), *row] for i, row in enumerate(rows)),
    ]


def _motive(path: Path, m: Motion) -> None:
    path.write_text(_text(_motive_rows(m, ["Table"], False), end="\r\n"))


def _motive_two(path: Path, m: Motion) -> None:
    path.write_text(_text(_motive_rows(m, ["Table", "Wand"], True), end="\r\n"))


def _qualisys(path: Path, m: Motion) -> None:
    matrix = rotation.matrix(m.attitude)
    names = [*(f"Table {a}" for a in "XYZ"), "Roll", "Pitch", "Yaw", "Residual"]
    names += [f"Rot[{i}]" for i in range(9)]
    head = [
        ["NO_OF_FRAMES", str(len(m.time))],
        ["NO_OF_CAMERAS", "8"],
        ["FREQUENCY", f"{RATE:g}"],
        ["NO_OF_BODIES", "1"],
        ["TIME_STAMP", "2026-02-03, 10:00:00.000", "1234.5"],
        ["DATA_INCLUDED", "6D"],
        ["BODY_NAMES", "Table"],
        ["Frame", "Time", *names],
    ]
    rows = _numbers(
        m.time,
        1e3 * m.position,
        m.euler[:, ::-1] / DEG,
        np.full(len(m.time), 0.2),
        matrix.transpose(0, 2, 1).reshape(-1, 9),
        digits=6,
    )
    body = [[str(i), *row] for i, row in enumerate(rows, 1)]
    path.write_text(_text([*head, *body], "\t", "\r\n"))


def _nexus_segments(m: Motion) -> str:
    vector = rotation.to_rotation_vector(m.attitude) / DEG
    rows = _numbers(vector, 1e3 * m.position, digits=6)
    return _text(
        [
            ["Segments"],
            [f"{RATE:g}"],
            ["", "", "Table:Table", "", "", "", "", ""],
            ["Frame", "Sub Frame", "RX", "RY", "RZ", "TX", "TY", "TZ"],
            ["", "", "deg", "deg", "deg", "mm", "mm", "mm"],
            *([str(i), "0", *row] for i, row in enumerate(rows, 1)),
        ]
    )


def _nexus(path: Path, m: Motion) -> None:
    path.write_text(_nexus_segments(m))


def _nexus_two(path: Path, m: Motion) -> None:
    rows = _numbers(1e3 * m.position, digits=6)
    markers = [
        ["Trajectories"],
        [f"{RATE:g}"],
        ["", "", "Table:M1", "", ""],
        ["Frame", "Sub Frame", "X", "Y", "Z"],
        ["", "", "mm", "mm", "mm"],
        *([str(i), "0", *row] for i, row in enumerate(rows, 1)),
    ]
    path.write_text(_nexus_segments(m) + "\n" + _text(markers))


def _xsens(path: Path, m: Motion) -> None:
    head = [
        "// General information:",
        "//  MT Manager version: 2022.0",
        "// Device information:",
        "//  DeviceId: 0380012B",
        f"//  Update Rate: {RATE:.1f}Hz",
        "//  Coordinate system: ENU",
    ]
    names = ["PacketCounter", "SampleTimeFine"]
    names += [f"Acc_{a}" for a in "XYZ"] + [f"Gyr_{a}" for a in "XYZ"]
    names += [f"Quat_q{i}" for i in range(4)]
    rows = _numbers(m.accelerometer, m.gyro, m.attitude, digits=6)
    ticks = np.round(1e4 * m.time).astype(int) + 523_000
    body = [
        [f"{(i + 65_000) % 65_536:05d}", str(tick), *row]
        for i, (tick, row) in enumerate(zip(ticks, rows, strict=True))
    ]
    path.write_text("\n".join(head) + "\n" + _text([names, *body], "\t"))


def _xsens_counter(path: Path, m: Motion) -> None:
    head = ["// Start Time: Unknown", f"// Update Rate: {RATE:.1f}Hz", "// Filter Profile: general"]
    matrix = rotation.matrix(m.attitude)
    names = ["PacketCounter", *(f"Gyr_{a}" for a in "XYZ")]
    names += [f"Mat[{row}][{column}]" for column in (1, 2, 3) for row in (1, 2, 3)]
    rows = _numbers(m.gyro, matrix.transpose(0, 2, 1).reshape(-1, 9), digits=6)
    body = [[f"{i:05d}", *row] for i, row in enumerate(rows) if i % 97 != 5]  # lost packets
    path.write_text("\n".join(head) + "\n" + _text([names, *body], "\t"))


def _vectornav(path: Path, m: Motion) -> None:
    names = ["Timestamp(ms)"]
    names += ["Yaw", "Pitch", "Roll"] + [f"Mag{a}" for a in "XYZ"] + [f"Accel{a}" for a in "XYZ"]
    names += [f"Gyro{a}" for a in "XYZ"]
    columns = (1e3 * m.time, m.euler / DEG, m.magnetometer / 1e-4, m.accelerometer, m.gyro)
    path.write_text(_text([names, *_numbers(*columns)]))


def _counter_alone(path: Path, m: Motion) -> None:
    rows = [[str(i), *row[1:]] for i, row in enumerate(_gyro_acc(m))]
    path.write_text(_text([["packet", *NAMES[1:]], *rows]))


def _nameless(path: Path, m: Motion) -> None:
    path.write_text(_text(_gyro_acc(m), " "))


def _words(path: Path, m: Motion) -> None:
    path.write_text("The platform was balanced by hand.\nNothing was recorded.\n" * len(m.time[:9]))


def _parquet(path: Path, m: Motion) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    stamps = pa.array(np.round(1e6 * (EPOCH + m.time)).astype(np.int64), pa.timestamp("us"))
    columns = {"stamp": stamps}
    columns |= {f"gyro_{a}": m.gyro[:, i] for i, a in enumerate("xyz")}
    columns |= {f"q{a}": m.attitude[:, i] for i, a in enumerate("wxyz")}
    parquet.write_table(pa.table(columns), path)


def _excel(path: Path, m: Motion) -> None:
    import openpyxl

    book = openpyxl.Workbook()
    sheet = book.active
    sheet.append(["Bench 2"])
    sheet.append(NAMES)
    sheet.append(["s", "deg/s", "deg/s", "deg/s", "m/s^2", "m/s^2", "m/s^2"])
    for row in np.column_stack([m.time, m.gyro / DEG, m.accelerometer]).tolist():
        sheet.append(row)
    book.save(path)


def _mat(path: Path, m: Motion) -> None:
    from scipy.io import savemat

    imu = {"time": m.time[:, None], "gyr": m.gyro, "acc": m.accelerometer}
    savemat(path, {"imu": imu, "note": "bench 2"})


def _mat73(path: Path, m: Motion) -> None:
    import h5py

    with h5py.File(path, "w", userblock_size=512) as file:
        group = file.create_group("imu")
        for name, values in (("time", m.time[:, None]), ("gyr", m.gyro), ("acc", m.accelerometer)):
            group.create_dataset(name, data=values.T).attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray(path.read_bytes())
    head = (
        b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Tue Feb  3 10:00:00 2026 HDF5 schema"
    )
    content[:128] = head.ljust(124, b" ") + b"\x00\x02IM"
    path.write_bytes(bytes(content))


def _hdf5(path: Path, m: Motion) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        imu = file.create_group("imu")
        imu["time"] = m.time
        imu.create_dataset("gyro", data=m.gyro / DEG, compression="gzip").attrs["units"] = "deg/s"
        imu["accel"] = m.accelerometer
        mocap = file.create_group("mocap")
        mocap["time"] = m.time
        mocap["quaternion"] = m.attitude


def _hdf5_table(path: Path, m: Motion) -> None:
    import h5py

    kind = np.dtype([("time", "f8"), *((f"gyro_{a}", "f8") for a in "xyz")])
    table = np.zeros(len(m.time), kind)
    table["time"] = m.time
    for i, axis in enumerate("xyz"):
        table[f"gyro_{axis}"] = m.gyro[:, i]
    with h5py.File(path, "w") as file:
        file["imu"] = table


def _labview(path: Path, m: Motion) -> None:
    from nptdms import ChannelObject, TdmsWriter

    clock = {"wf_increment": 1.0 / RATE, "wf_start_offset": 0.0, "unit_string": "deg/s"}
    with TdmsWriter(str(path)) as writer:
        writer.write_segment(
            [
                ChannelObject("imu", f"gyro_{axis}", m.gyro[:, i] / DEG, clock)
                for i, axis in enumerate("xyz")
            ]
        )


def _ulog(path: Path, m: Motion) -> None:
    def message(kind: bytes, body: bytes) -> bytes:
        return struct.pack("<HB", len(body), kind[0]) + body

    # PX4: north, east, down; forward, right, down
    turned = np.array([1.0, -1.0, -1.0])
    attitude = (m.attitude * [1.0, 1.0, -1.0, -1.0]).astype("<f4")
    gyro = (m.gyro * turned).astype("<f4")
    accelerometer = (m.accelerometer * turned).astype("<f4")
    out = io.BytesIO()
    out.write(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))
    out.write(message(b"B", bytes(40)))
    out.write(message(b"F", b"vehicle_attitude:uint64_t timestamp;float[4] q;"))
    fields = b"float[3] gyro_rad;float[3] accelerometer_m_s2;"
    out.write(message(b"F", b"sensor_combined:uint64_t timestamp;" + fields))
    out.write(message(b"A", struct.pack("<BH", 0, 0) + b"vehicle_attitude"))
    out.write(message(b"A", struct.pack("<BH", 0, 1) + b"sensor_combined"))
    for i, time in enumerate(m.time):
        stamp = struct.pack("<Q", round(1e6 * (time + 12.0)))
        out.write(message(b"D", struct.pack("<H", 0) + stamp + attitude[i].tobytes()))
        sensors = gyro[i].tobytes() + accelerometer[i].tobytes()
        out.write(message(b"D", struct.pack("<H", 1) + stamp + sensors))
    path.write_bytes(out.getvalue())


def _json_mcap(path: Path, m: Motion) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/imu", "json", 0)
        for time, rate in zip(m.time, m.gyro, strict=True):
            data = json.dumps({"gyro": dict(zip("xyz", rate.tolist(), strict=True))}).encode()
            stamp = round(1e9 * (EPOCH + time))
            writer.add_message(channel, log_time=stamp, publish_time=stamp, data=data)
        writer.finish()


CUSTOM = "std_msgs/Header header\nfloat64 wx\nfloat64 wy\nfloat64 wz\nfloat64 temperature"
PX4_ATTITUDE = "uint64 timestamp\nuint64 timestamp_sample\nfloat32[4] q\nfloat32[4] delta_q_reset"


def _ros_messages(types, kind: str, m: Motion) -> Iterator[tuple[int, object]]:
    """A ROS message of a type a row."""
    t = types.types
    header_type, time_type = t["std_msgs/msg/Header"], t["builtin_interfaces/msg/Time"]
    vector, quaternion = t["geometry_msgs/msg/Vector3"], t["geometry_msgs/msg/Quaternion"]
    point = t["geometry_msgs/msg/Point"]
    ros1 = "seq" in getattr(header_type, "__dataclass_fields__", {})
    none = np.zeros(9)
    for i, time in enumerate(m.time):
        stamp = round(1e9 * (EPOCH + time))
        now = time_type(sec=stamp // 10**9, nanosec=stamp % 10**9)
        more = {"seq": i} if ros1 else {}
        header = header_type(stamp=now, frame_id="body", **more)
        w, x, y, z = m.attitude[i].tolist()
        turned = quaternion(x=x, y=y, z=z, w=w)
        rate = vector(*m.gyro[i].tolist())
        force = vector(*m.accelerometer[i].tolist())
        place = point(*m.position[i].tolist())
        match kind.rpartition("/")[2]:
            case "Imu":
                made = t[kind](
                    header=header,
                    orientation=turned,
                    orientation_covariance=none,
                    angular_velocity=rate,
                    angular_velocity_covariance=none,
                    linear_acceleration=force,
                    linear_acceleration_covariance=none,
                )
            case "PoseStamped":
                pose = t["geometry_msgs/msg/Pose"](position=place, orientation=turned)
                made = t[kind](header=header, pose=pose)
            case "TransformStamped":
                offset = vector(*m.position[i].tolist())
                change = t["geometry_msgs/msg/Transform"](translation=offset, rotation=turned)
                made = t[kind](header=header, child_frame_id="table", transform=change)
            case "Odometry":
                pose = t["geometry_msgs/msg/Pose"](position=place, orientation=turned)
                twist = t["geometry_msgs/msg/Twist"](linear=vector(0.0, 0.0, 0.0), angular=rate)
                wide = np.zeros(36)
                made = t[kind](
                    header=header,
                    child_frame_id="table",
                    pose=t["geometry_msgs/msg/PoseWithCovariance"](pose=pose, covariance=wide),
                    twist=t["geometry_msgs/msg/TwistWithCovariance"](twist=twist, covariance=wide),
                )
            case "MagneticField":
                field = vector(*m.magnetometer[i].tolist())
                made = t[kind](header=header, magnetic_field=field, magnetic_field_covariance=none)
            case "Vector3Stamped":
                made = t[kind](header=header, vector=rate)
            case "Rates":
                made = t[kind](header, *m.gyro[i].tolist(), 293.0)
            case "Float64MultiArray":
                layout = t["std_msgs/msg/MultiArrayLayout"](dim=[], data_offset=0)
                made = t[kind](layout=layout, data=np.array(m.gyro[i]))
            case _:
                q = (m.attitude[i] * [1.0, 1.0, -1.0, -1.0]).astype(np.float32)
                micro = stamp // 1000
                made = t[kind](micro, micro, q, np.zeros(4, np.float32))
        yield stamp, made


def _ros2(kind: str, topic: str, plugin: str) -> Callable[[Path, Motion], None]:
    def write(path: Path, m: Motion) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        types = get_typestore(Stores.ROS2_JAZZY)
        types.register(get_types_from_msg(CUSTOM, "lab_msgs/msg/Rates"))
        types.register(get_types_from_msg(PX4_ATTITUDE, "px4_msgs/msg/VehicleAttitude"))
        folder = path.with_suffix(".bagged")
        with Writer(folder, version=9, storage_plugin=StoragePlugin[plugin]) as writer:
            connection = writer.add_connection(topic, kind, typestore=types)
            for stamp, message in _ros_messages(types, kind, m):
                writer.write(connection, stamp + 2_000_000, types.serialize_cdr(message, kind))
        (inside,) = folder.glob(f"*{path.suffix}")
        inside.rename(path)
        for rest in folder.iterdir():
            rest.unlink()
        folder.rmdir()

    return write


def _ros1(kind: str, topic: str) -> Callable[[Path, Motion], None]:
    def write(path: Path, m: Motion) -> None:
        from rosbags.rosbag1 import Writer
        from rosbags.typesys import Stores, get_typestore

        types = get_typestore(Stores.ROS1_NOETIC)
        with Writer(path) as writer:
            connection = writer.add_connection(topic, kind, typestore=types)
            for stamp, message in _ros_messages(types, kind, m):
                writer.write(connection, stamp, types.serialize_ros1(message, kind))

    return write


INERTIAL = ("gyro", "accelerometer")
ALL_THREE = ("gyro", "accelerometer", "magnetometer")
SINGLE = 1e-6
"""Rounding of a 32-bit float of that size."""

MAKERS = (
    Maker("CSV", "a.csv", _plain, INERTIAL),
    Maker("CSV with semicolons and decimal commas", "a.csv", _semicolons, INERTIAL),
    Maker("TSV", "a.tsv", _tabs, INERTIAL),
    Maker("text in columns of spaces", "a.txt", _spaces, INERTIAL),
    Maker("CSV with a row of units", "a.csv", _units_below, INERTIAL),
    Maker("CSV with units in brackets", "a.csv", _units_in_brackets, INERTIAL),
    Maker("CSV with DPS, milli-g and Gauss", "a.csv", _spelt_otherwise, ALL_THREE),
    Maker("CSV below comments", "a.csv", _comments, INERTIAL),
    Maker("numpy.savetxt", "a.txt", _savetxt, INERTIAL),
    Maker("CSV with ISO dates", "a.csv", _dates, INERTIAL),
    Maker("pandas with an index and dates", "a.csv", _pandas, INERTIAL),
    Maker("CSV in microseconds since 1970", "a.csv", _microseconds, INERTIAL),
    Maker("text in UTF-16", "a.txt", _utf16, INERTIAL),
    Maker("LabVIEW text, German Windows", "a.txt", _windows, INERTIAL),
    Maker("CSV whose rows end with a comma", "a.csv", _ended, INERTIAL),
    Maker("oscilloscope, first line blank", "a.csv", _oscilloscope, INERTIAL),
    Maker("Excel CSV with sep=;", "a.csv", _excel_csv, INERTIAL),
    Maker("CSV with a counter before the clock", "a.csv", _indexed, INERTIAL),
    Maker("CSV with a quaternion", "a.csv", _quaternion_csv, ("attitude", "gyro")),
    Maker("CSV with a quaternion, scalar last", "a.csv", _scalar_last, ("attitude", "gyro")),
    Maker("CSV with Euler angles", "a.csv", _euler_csv, ("attitude", *INERTIAL)),
    Maker("Bosch-style logger", "a.csv", _bosch, INERTIAL),
    Maker("serial logger", "a.log", _serial, INERTIAL),
    Maker("x-IMU / Fusion", "a.csv", _fusion, ALL_THREE),
    Maker("OptiTrack Motive", "a.csv", _motive, ("attitude", "position"), 1e-5),
    Maker("OptiTrack Motive, two bodies", "a.csv", _motive_two, ("attitude", "position"), 1e-5),
    Maker("Qualisys 6D", "a.tsv", _qualisys, ("attitude", "position"), 1e-5),
    Maker("Vicon Nexus, segments", "a.csv", _nexus, ("attitude", "position"), 1e-5),
    Maker("Vicon Nexus, two tables", "a.csv", _nexus_two, ("attitude", "position"), 1e-5),
    Maker("Xsens MT Manager", "a.txt", _xsens, ("attitude", *INERTIAL), 1e-5),
    Maker("Xsens MT Manager, counter only", "a.txt", _xsens_counter, ("attitude", "gyro"), 1e-5),
    Maker("VectorNav Control Center", "a.csv", _vectornav, ("attitude", *ALL_THREE)),
    Maker("Parquet", "a.parquet", _parquet, ("attitude", "gyro")),
    Maker("Excel", "a.xlsx", _excel, INERTIAL),
    Maker("MATLAB 5, struct", "a.mat", _mat, INERTIAL),
    Maker("MATLAB 7.3", "a.mat", _mat73, INERTIAL),
    Maker("HDF5, groups", "a.h5", _hdf5, ("attitude", *INERTIAL)),
    Maker("HDF5, table of records", "a.hdf5", _hdf5_table, ("gyro",)),
    Maker("LabVIEW TDMS", "a.tdms", _labview, ("gyro",)),
    Maker("PX4 ULog", "a.ulg", _ulog, ("attitude", *INERTIAL), 1e-5),
    Maker("MCAP, JSON", "a.mcap", _json_mcap, ("gyro",)),
    *(
        Maker(f"ROS 2 MCAP, {kind}", "a.mcap", _ros2(kind, topic, "MCAP"), streams)
        for kind, topic, streams in (
            ("sensor_msgs/msg/Imu", "/imu", ("attitude", *INERTIAL)),
            ("geometry_msgs/msg/PoseStamped", "/pose", ("attitude", "position")),
            ("geometry_msgs/msg/TransformStamped", "/vicon", ("attitude", "position")),
            ("sensor_msgs/msg/MagneticField", "/mag", ("magnetometer",)),
            ("geometry_msgs/msg/Vector3Stamped", "/gyro", ("gyro",)),
            ("lab_msgs/msg/Rates", "/rates", ("gyro",)),
        )
    ),
    Maker(
        "ROS 2 MCAP, px4_msgs/VehicleAttitude",
        "a.mcap",
        _ros2("px4_msgs/msg/VehicleAttitude", "/fmu/out/vehicle_attitude", "MCAP"),
        ("attitude",),
        1e-5,
    ),
    Maker(
        "ROS 2 SQLite, sensor_msgs/Imu",
        "a.db3",
        _ros2("sensor_msgs/msg/Imu", "/imu", "SQLITE3"),
        ("attitude", *INERTIAL),
    ),
    Maker(
        "ROS 1 bag, sensor_msgs/Imu",
        "a.bag",
        _ros1("sensor_msgs/msg/Imu", "/imu"),
        ("attitude", *INERTIAL),
    ),
    Maker(
        "ROS 1 bag, nav_msgs/Odometry",
        "a.bag",
        _ros1("nav_msgs/msg/Odometry", "/odom"),
        ("attitude", "gyro", "position"),
    ),
    Maker(
        "CSV with a counter and no rate", "a.csv", _counter_alone, (), refused="no column of times"
    ),
    Maker("numbers without names", "a.txt", _nameless, (), refused="no names above its 7 columns"),
    Maker("words", "a.txt", _words, (), refused="no stream"),
    Maker(
        "ROS 2 MCAP, std_msgs/Float64MultiArray",
        "a.mcap",
        _ros2("std_msgs/msg/Float64MultiArray", "/data", "MCAP"),
        (),
        refused="no stream among",
    ),
)

MODELS = Path(__file__).parents[2] / "models"
REAL = (
    *(
        (f"dfki_pendulum/logs/{log}", "dfki_pendulum")
        for log in ("energy_shaping", "energy_shaping_1kg", "sysid")
    ),
    ("broad_imu/logs/slow_rotation", None),
)
"""Shipped logs of other labs, and the machine: what their authors' files say by themselves."""


def files_of(folder: Path) -> list[str]:
    """The names of a log's files of numbers."""
    return sorted(path.name for path in folder.iterdir() if path.name != "log.toml")
