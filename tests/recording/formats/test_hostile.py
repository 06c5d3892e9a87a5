"""A small file that unpacks to the size of a memory, or has no end, is refused before it does."""

import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.processes import PATIENCE

GYRO = '[streams.gyro]\nfile = "a.{}"\n'
MEMORY = 500
"""Of a reader [MB]."""
WIDTH = 40_000_000
"""Numbers that a hostile file says it holds: 320 MB, of some hundred kB."""


def _matlab(path: Path) -> None:
    from scipy.io import savemat

    savemat(path, {"gyr": np.zeros((8, 4))})
    head = path.read_bytes()[:128]
    rows, columns = WIDTH // 4, 4
    flags = np.array([6, 8, 6, 0], "<u4").tobytes()
    dimensions = np.array([5, 8, rows, columns], "<u4").tobytes()
    name = np.array([1 | 3 << 16], "<u4").tobytes() + b"gyr\0"
    body = flags + dimensions + name + np.array([9, 8 * WIDTH], "<u4").tobytes()
    inside = np.array([14, len(body) + 8 * WIDTH], "<u4").tobytes() + body
    path.write_bytes(head + _squeezed(inside))


def _matlab_struct(path: Path) -> None:
    """As `_matlab`, in the field of a struct, which says nothing of its size."""
    from scipy.io import savemat

    def element(code: int, data: bytes) -> bytes:
        return np.array([code, len(data)], "<u4").tobytes() + data + bytes(-len(data) % 8)

    def matrix(kind: int, rows: int, columns: int, name: bytes) -> bytes:
        flags = element(6, np.array([kind, 0], "<u4").tobytes())
        return flags + element(5, np.array([rows, columns], "<i4").tobytes()) + element(1, name)

    savemat(path, {"s": np.zeros((8, 4))})
    head = path.read_bytes()[:128]
    size = 8 * WIDTH
    numbers = matrix(6, WIDTH // 4, 4, b"") + np.array([9, size], "<u4").tobytes()
    names = np.array([4 << 16 | 5, 32], "<u4").tobytes() + element(1, b"gyr".ljust(32, b"\0"))
    body = matrix(2, 1, 1, b"s") + names
    body += np.array([14, len(numbers) + size], "<u4").tobytes() + numbers
    path.write_bytes(head + _squeezed(np.array([14, len(body) + size], "<u4").tobytes() + body))


def _matlab_zeros(path: Path) -> None:
    """What unpacks to no variable at all."""
    from scipy.io import savemat

    savemat(path, {"gyr": np.zeros((8, 4))})
    path.write_bytes(path.read_bytes()[:128] + _squeezed(b""))


def _squeezed(start: bytes) -> bytes:
    """A compressed element of a MAT file, of these bytes and then zeros without end."""
    squeezer = zlib.compressobj()
    packed = squeezer.compress(start)
    for _ in range(8 * WIDTH >> 24):
        packed += squeezer.compress(bytes(1 << 24))
    packed += squeezer.flush()
    return np.array([15, len(packed)], "<u4").tobytes() + packed


def _matlab_code(path: Path) -> None:
    """Numbers of a type that there is none of, which ends a process within SciPy."""
    from scipy.io import savemat

    savemat(path, {"gyr": np.ones((8, 4))})
    head, double, numbers = path.read_bytes().partition(bytes([9, 0, 0, 0, 0, 1, 0, 0]))
    path.write_bytes(head + bytes([0, 0, 1, 0]) + double[4:] + numbers)


def _hdf5(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file.create_dataset("gyr", (WIDTH // 4, 4), "f8", compression="gzip", chunks=(4096, 4))


def _excel(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as book:
        book.writestr("[Content_Types].xml", "<Types/>")
        with book.open("xl/worksheets/sheet1.xml", "w", force_zip64=True) as sheet:
            for _ in range(20):
                sheet.write(bytes(1 << 24))


def _mcap(path: Path) -> None:
    import zstandard

    with path.open("wb") as file:
        from mcap.writer import Writer

        writer = Writer(file)
        writer.start()
        writer.finish()
    squeezer = zstandard.ZstdCompressor().compressobj(size=8 * WIDTH)
    packed = b"".join(squeezer.compress(bytes(1 << 24)) for _ in range(8 * WIDTH >> 24))
    packed += squeezer.compress(bytes(8 * WIDTH - (8 * WIDTH >> 24 << 24))) + squeezer.flush()
    words = np.array([0, 0, 8 * WIDTH], "<u8").tobytes() + bytes(4)
    words += np.array([4], "<u4").tobytes() + b"zstd" + np.array([len(packed)], "<u8").tobytes()
    chunk = b"\x06" + np.array([len(words) + len(packed)], "<u8").tobytes() + words + packed
    whole = path.read_bytes()
    head = 8 + 9 + int.from_bytes(whole[9:17], "little")
    path.write_bytes(whole[:head] + chunk + whole[head:])


def _lying_mcap(path: Path) -> None:
    """A chunk that holds more than it says."""
    import lz4.frame

    with path.open("wb") as file:
        from mcap.writer import Writer

        writer = Writer(file)
        writer.start()
        writer.finish()
    packer = lz4.frame.LZ4FrameCompressor()
    parts = [packer.begin(), *(packer.compress(bytes(1 << 24)) for _ in range(8 * WIDTH >> 24))]
    packed = b"".join([*parts, packer.flush()])
    words = np.array([0, 0, 1000], "<u8").tobytes() + bytes(4)
    words += np.array([3], "<u4").tobytes() + b"lz4" + np.array([len(packed)], "<u8").tobytes()
    chunk = b"\x06" + np.array([len(words) + len(packed)], "<u8").tobytes() + words + packed
    whole = path.read_bytes()
    head = 8 + 9 + int.from_bytes(whole[9:17], "little")
    path.write_bytes(whole[:head] + chunk + whole[head:])


def _parquet(path: Path) -> None:
    import pyarrow as pa
    from pyarrow import parquet

    part = pa.table({name: np.zeros(1 << 20) for name in "txyz"})
    with parquet.ParquetWriter(path, part.schema) as file:
        for _ in range(WIDTH >> 22):
            file.write_table(part)


def _parquet_lists(path: Path) -> None:
    """Some rows of a million numbers each."""
    import pyarrow as pa
    from pyarrow import parquet

    numbers = pa.array(np.zeros(WIDTH))
    rows = pa.FixedSizeListArray.from_arrays(numbers, 1_000_000)
    parquet.write_table(pa.table({"t": np.arange(len(rows)) * 0.01, "x": rows}), path)


def _parquet_text(path: Path) -> None:
    """One text of 300 kB in each of ten thousand rows: 3 GB of what nobody asks for."""
    import pyarrow as pa
    from pyarrow import parquet

    count = 10_000
    columns = {name: np.arange(count) * 0.01 for name in "txy"}
    note = pa.DictionaryArray.from_arrays(np.zeros(count, np.int32), ["a" * 300_000])
    table = pa.table({**columns, "note": note})
    parquet.write_table(table, path, store_schema=False)


def _feather(path: Path) -> None:
    import pyarrow as pa
    from pyarrow import feather

    table = pa.table({name: np.zeros(WIDTH // 8) for name in "txyz"})
    feather.write_feather(table, path, compression="zstd")


def _stepped_json(path: Path) -> None:
    """Every row has a key of its own, so that the table is as wide as long."""
    path.write_text("".join(f'{{"k{i}": 1}}\n' for i in range(9_000)))


def _numpy_zip(path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as parts:
        shape = f"{{'descr': '<f8', 'fortran_order': False, 'shape': ({WIDTH},), }}"
        head = b"\x93NUMPY\x01\x00v\x00" + shape.encode().ljust(117) + b"\n"
        with parts.open("gyr.npy", "w", force_zip64=True) as part:
            part.write(head)
            for _ in range(8 * WIDTH >> 24):
                part.write(bytes(1 << 24))


def _numpy_objects(path: Path) -> None:
    """A pickle, which would run code."""
    np.save(path, np.array([{"a": 1}] * 8, dtype=object), allow_pickle=True)


def _message_zstd(path: Path) -> None:
    """A message of ROS 2 that is compressed by itself, and unpacks to 130 MB."""
    import sqlite3

    import zstandard

    packer = zstandard.ZstdCompressor().compressobj()
    zeros = (packer.compress(bytes(1 << 24)) for _ in range(8))
    message = b"".join([*zeros, packer.flush()])
    base = sqlite3.connect(path)
    base.execute(
        "CREATE TABLE topics(id INTEGER, name TEXT, type TEXT, serialization_format TEXT, "
        "offered_qos_profiles TEXT)"
    )
    base.execute(
        "CREATE TABLE messages(id INTEGER, topic_id INTEGER, timestamp INTEGER, data BLOB)"
    )
    base.execute("INSERT INTO topics VALUES(1, '/g', 'std_msgs/msg/Float64', 'cdr', '')")
    base.execute("INSERT INTO messages VALUES(1, 1, 1, ?)", (message,))
    base.commit()
    base.close()


def _bag(path: Path) -> None:
    """A chunk of a good message, and then of 130 MB of zeros."""
    import bz2

    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    def packed(data: bytes) -> bytes:
        packer = bz2.BZ2Compressor(1)
        zeros = (packer.compress(bytes(1 << 24)) for _ in range(8))
        return b"".join([packer.compress(data), *zeros, packer.flush()])

    types = get_typestore(Stores.ROS1_NOETIC)
    kind = "std_msgs/msg/Float64"
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    writer.compressor = packed
    with writer:
        connection = writer.add_connection("/g", kind, typestore=types)
        message = types.types[kind](data=1.0)
        writer.write(connection, 1, types.serialize_ros1(message, kind))


def _laughs(path: Path) -> None:
    """A sheet whose text refers to itself again and again."""
    import openpyxl

    book = openpyxl.Workbook()
    book.active.append(["t", "x", "y", "z"])
    book.save(path)
    words = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10 if i else "ha"}">' for i in range(10))
    sheet = (
        f'<!DOCTYPE x [{words}]><worksheet xmlns="http://schemas.openxmlformats.org/spreadsheetml/'
        '2006/main"><sheetData><row r="1"><c r="A1" t="inlineStr"><is><t>&a9;</t></is></c></row>'
        "</sheetData></worksheet>"
    )
    with zipfile.ZipFile(path) as old:
        parts = {name: old.read(name) for name in old.namelist()}
    with zipfile.ZipFile(path, "w") as new:
        for name, data in parts.items():
            new.writestr(name, sheet if "sheet1" in name else data)


def _deep_json(path: Path) -> None:
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel("/g", "json", 0)
        writer.add_message(channel, 0, b"[" * 100_000 + b"]" * 100_000, 0)
        writer.finish()


def _wide(path: Path) -> None:
    path.write_text(",".join(f"c{i}" for i in range(100_000)) + "\n" + "1," * 99_999 + "1\n")


def _wider(path: Path) -> None:
    """A million columns: a line longer than any row."""
    path.write_text(",".join(f"c{i}" for i in range(1_000_000)) + "\n" + "1," * 999_999 + "1\n")


def _external(path: Path) -> None:
    import h5py

    with h5py.File(path, "w") as file:
        file["gyr"] = h5py.ExternalLink("/etc/passwd", "/gyr")
        file.create_dataset("acc", (1000, 3), "f8", external=[("/etc/passwd", 0, 24000)])


CODE = """
import resource, sys, time
resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))
from twin.errors import LogError
from twin.recording import open_log
start = time.process_time()
try:
    open_log(sys.argv[1])
except LogError as error:
    print(error)
print(time.process_time() - start)
print(open("/proc/self/status").read().split("VmHWM:")[1].split()[0])
"""


@pytest.mark.parametrize(
    ("ending", "write", "said"),
    [
        ("mat", _matlab, "would unpack to"),
        ("mat", _matlab_struct, "would unpack to"),
        ("mat", _matlab_zeros, "would unpack to"),
        ("mat", _matlab_code, "data of type 0"),
        ("h5", _hdf5, "would unpack to"),
        ("xlsx", _excel, "would unpack to"),
        ("mcap", _mcap, "would unpack to"),
        ("mcap", _lying_mcap, "is cut short before its first message"),
        ("mcap", _deep_json, "cannot be decoded"),
        ("parquet", _parquet, "would unpack to"),
        ("parquet", _parquet_lists, "would unpack to"),
        ("parquet", _parquet_text, "'note' holds string, no numbers"),
        ("bag", _bag, "would unpack to"),
        ("xlsx", _laughs, "cannot be read as Excel"),
        ("feather", _feather, "would unpack to"),
        ("jsonl", _stepped_json, "would unpack to"),
        ("npz", _numpy_zip, "would unpack to"),
        ("npy", _numpy_objects, "cannot be read as a NumPy file"),
        ("db3", _message_zstd, "would unpack to"),
        ("csv", _wide, "has 100000 columns"),
        ("csv", _wider, "a line of more than 1 MiB"),
        ("h5", _external, "no numeric variable"),
    ],
    ids=lambda value: getattr(value, "__name__", None),
)
def test_a_hostile_file_is_refused_soon_and_in_little_memory(
    tmp_path: Path, ending: str, write: Callable[[Path], None], said: str
):
    write(tmp_path / f"a.{ending}")
    (tmp_path / "log.toml").write_text(GYRO.format(ending))
    done = subprocess.run(
        [sys.executable, "-c", CODE, str(tmp_path)],
        capture_output=True,
        text=True,
        timeout=PATIENCE,
    )
    assert not done.stderr, done.stderr
    text, seconds, peak = done.stdout.splitlines()
    assert said in text
    assert float(seconds) < 5.0
    assert int(peak) < 1000 * MEMORY
