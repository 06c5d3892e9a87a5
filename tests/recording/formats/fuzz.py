"""Damaged and hostile files of every format: each is read, or refused with one of our sentences.

`python tests/recording/formats/fuzz.py --seconds 300` (or `--runs 2000`) goes on for longer than
the suite does; `--seed` draws other damage, `--keep FOLDER` keeps what fails. A case starts from a
valid file: bits flip, numbers become extreme, pieces vanish, come twice, are exchanged with those
of another file; of zipped and compressed files what is inside is damaged too. The log is opened and
its tables are looked at as `twin import` does. It must end within `SECONDS` of processor time and
`MEMORY`, and raise nothing but a LogError or a RecordingError. Cases run in a process of their own,
so that a library that crashes is a failure of that case and not the end.
"""

import argparse
import io
import json
import random
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import traceback
import warnings
import zipfile
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType

ROOT = Path(__file__).parents[3]
SECONDS = 10.0
"""Of processor time that a case may take [s]."""
HUNG = 120.0
"""Without a word from the process that reads [s]."""
MEMORY = 500
"""That a case may take beyond what the process had [MB]."""
SPACE = 6 << 30
"""Addresses that the process may have [bytes]; beyond, an allocation fails."""
EXTREME = [
    value.to_bytes(size, order)
    for size in (2, 4, 8)
    for value in (0, 1, 256**size - 1, 256**size // 2, 256**size // 2 - 1)
    for order in ("little", "big")
]
"""Lengths, counts and places that break parsers."""
WORDS = [
    *(b"nan", b"inf", b"-inf", b"1e999", b"1e-999", b"-0.0", b"1" * 400, b"0x10", b"1_0"),
    *(b"", b",", b";", b"\t", b"\n", b"\n\n", b"\r", b'"', b"'", b"\0", b"\xff", b"\xef\xbb\xbf"),
    *(b"1,5", b"1.234,5", b"2024-01-01", b"99:99:99", b"9999-99-99T99:99:99Z", b"null", b"{}"),
]
"""Cells that break readers of tables."""


class TooLong(BaseException):
    """A case took more than its time; no reader may take this for damage."""


# Damage.


def flip(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """Some bits."""
    for _ in range(chance.choice((1, 1, 2, 8, 64))):
        data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)


def cut(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """The end is missing, or the beginning."""
    place = chance.randrange(len(data))
    del data[slice(place, None) if chance.random() < 0.8 else slice(0, place)]


def drop(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """A piece vanishes."""
    place = chance.randrange(len(data))
    del data[place : place + chance.choice((1, 4, 64, 4096))]


def repeat(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """A piece comes again, some times."""
    place, size = chance.randrange(len(data)), chance.choice((1, 8, 64, 1024))
    data[place:place] = data[place : place + size] * chance.choice((1, 2, 100))


def extreme(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """A number, wherever one may be, becomes an extreme one; most lengths stand at the ends."""
    for _ in range(chance.choice((1, 1, 3))):
        value = chance.choice(EXTREME)
        reach = chance.choice((64, 1024, len(data)))
        place = chance.randrange(min(reach, len(data)))
        place = place if chance.random() < 0.6 else len(data) - 1 - place
        data[place : place + len(value)] = value


def word(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """A cell becomes another."""
    for _ in range(chance.choice((1, 3, 20))):
        place = chance.randrange(len(data) + 1)
        data[place : place + chance.choice((0, 1, 8))] = chance.choice(WORDS)


def blank(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """A stretch was never written, or is noise."""
    place, size = chance.randrange(len(data)), chance.choice((8, 512, 65536))
    size = min(size, len(data) - place)
    data[place : place + size] = chance.choice(
        (bytes(size), b"\xff" * size, chance.randbytes(size))
    )


def splice(data: bytearray, chance: random.Random, others: list[bytes]) -> None:
    """A piece of another file."""
    other = chance.choice(others)
    start, place = chance.randrange(len(other)), chance.randrange(len(data))
    size = chance.choice((16, 256, 4096))
    data[place : place + size] = other[start : start + size]


DAMAGE: list[Callable[[bytearray, random.Random, list[bytes]], None]] = [
    *(flip, cut, drop, repeat, extreme, word, blank, splice)
]


def damaged(content: bytes, chance: random.Random, others: list[bytes]) -> bytes:
    """A file with one to three kinds of damage; in a zipped one mostly inside."""
    if content.startswith(b"PK") and chance.random() < 0.8:
        return _inside_zip(content, chance, others)
    data = bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 3))):
        if data:
            chance.choice(DAMAGE)(data, chance, others)
    return bytes(data)


def _inside_zip(content: bytes, chance: random.Random, others: list[bytes]) -> bytes:
    out = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(content)) as book, zipfile.ZipFile(out, "w") as copy:
        names = book.namelist()
        hit = chance.choice(names)
        for name in names:
            data = bytearray(book.read(name))
            if name == hit and data:
                chance.choice(DAMAGE)(data, chance, others)
            copy.writestr(name, bytes(data))
    return out.getvalue()


# Valid files.


def write_seeds(folder: Path, *, layouts: bool = True) -> None:
    """Logs in folders of their own: one of each layout of each format, or of each format only."""
    sys.path.insert(0, str(ROOT / "tests" / "intake"))  # its modules name each other
    import devices
    import makers

    from twin.intake import import_files
    from twin.recording import read_log
    from twin.stream.runfile import write_recording

    motion = makers.motion(7, 3.0)
    known = set[str]()
    for maker in (*makers.MAKERS, *devices.DEVICES):
        ending = Path(maker.file).suffix.lower()
        kind = maker.name if layouts else ending
        if maker.refused or kind in known or not ending:  # a folder of files
            continue
        known.add(kind)
        with tempfile.TemporaryDirectory() as place:
            path = Path(place) / maker.file
            maker.write(path, motion)
            import_files([path], folder / f"{len(known):02d}{ending}", None, None)
    _without_checksums(folder)
    log = next(path for path in sorted(folder.iterdir()) if path.suffix == ".csv")
    (folder / "recording.rrd").mkdir()
    write_recording(read_log(log), folder / "recording.rrd" / "a.rrd")


def _without_checksums(folder: Path) -> None:
    """MCAP files whose chunks and sections have no checksum, so that damage gets further."""
    from mcap.reader import make_reader
    from mcap.writer import CompressionType, Writer

    for number, source in enumerate(sorted(folder.glob("*.mcap"))):
        target = folder / f"plain{number}.mcap"
        shutil.copytree(source, target)
        (path,) = target.glob("*.mcap")
        with (source / path.name).open("rb") as file, path.open("wb") as out:
            writer = Writer(
                out,
                compression=list(CompressionType)[number % 3],
                enable_crcs=False,
                enable_data_crcs=False,
            )
            writer.start()
            channels = dict[int, int]()
            for schema, channel, message in make_reader(file).iter_messages():
                if channel.id not in channels:
                    kind = 0
                    if schema is not None:
                        kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, kind
                    )
                writer.add_message(
                    channels[channel.id], message.log_time, message.data, message.publish_time
                )
            writer.finish()


def file_of(seed: Path) -> Path:
    """The file of numbers in the folder of a log."""
    return next(path for path in sorted(seed.iterdir()) if path.name != "log.toml")


# Cases.


def read_all(log: Path) -> str:
    """Open a log and look at its file as `twin import` does; what was said against it."""
    from twin.errors import LogError, RecordingError
    from twin.intake.tables import tables_in
    from twin.recording import open_log

    path = file_of(log)
    said = "read"
    try:
        open_log(path if path.suffix == ".rrd" else log)
        for table in tables_in(path) if path.suffix != ".rrd" else ():
            for name in table.names:
                table.column(name)
    except (LogError, RecordingError) as problem:
        said = str(problem)
    return said


def work(seeds: Path, seed: int, first: int, stop: float, runs: int) -> None:
    """Run cases in this process; a line of JSON before and after each."""
    import twin.intake.tables  # noqa: F401  (its memory is no case's)

    warnings.simplefilter("error")  # a user would see them
    warnings.filterwarnings("ignore", module="rerun")  # what it warns of, `repairs` says
    signal.signal(signal.SIGPROF, _too_long)
    resource.setrlimit(resource.RLIMIT_AS, (SPACE, SPACE))
    valid = {log: file_of(log).read_bytes() for log in sorted(seeds.iterdir())}
    others = list(valid.values())
    endings = sorted({log.suffix for log in valid})
    with tempfile.TemporaryDirectory() as place:
        number = first
        while number < runs and time.time() < stop:
            chance = random.Random(f"{seed} {number}")
            ending = endings[number % len(endings)]
            log = chance.choice([log for log in valid if log.suffix == ending])
            copy = Path(place) / log.name
            if not copy.exists():
                shutil.copytree(log, copy)
            file_of(copy).write_bytes(damaged(valid[log], chance, others))
            print(json.dumps({"case": number, "file": log.name, "path": str(file_of(copy))}))
            sys.stdout.flush()
            print(json.dumps({"case": number, "failed": _failure(copy)}), flush=True)
            number += 1


def _failure(log: Path) -> str:
    """What is wrong with the way in which a case ended; empty where nothing is."""
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    before = _memory("VmRSS")
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        said = read_all(log)
    except TooLong:
        return f"takes longer than {SECONDS:g} s\n{traceback.format_exc()}"
    except BaseException:
        return traceback.format_exc()
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    grown = _memory("VmHWM") - before
    if grown > MEMORY:
        return f"takes {grown} MB"
    return "" if len(said) < 5000 and "\x1b" not in said else f"says {said[:200]!r}, and more"


def _too_long(number: int, frame: FrameType | None) -> None:
    raise TooLong


def _memory(key: str) -> int:
    """[MB]"""
    status = Path("/proc/self/status").read_text()
    return int(status.split(f"{key}:")[1].split()[0]) // 1024


def fuzz(
    seeds: Path, *, seed: int, runs: int, seconds: float, keep: Path | None = None
) -> tuple[int, list[str]]:
    """How many cases ran, and what failed: at most so many, and no longer than that [s].

    Args:
        seeds: a folder of logs, from `write_seeds`.
        seed: of the damage.
        runs: cases at most.
        seconds: time at most.
        keep: where files that fail are kept.
    """
    stop = time.time() + seconds
    failures = list[str]()
    done = 0
    while done < runs and time.time() < stop:
        command = [sys.executable, __file__, "--work", str(seeds), str(seed), str(done)]
        command += [str(stop), str(runs)]
        began: dict[str, object] = {}
        with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT, text=True) as process:
            for line in _lines(process):
                said = json.loads(line)
                if "file" in said:
                    began = said
                    continue
                done = said["case"] + 1
                if said["failed"]:
                    failures.append(f"case {said['case']}, {began['file']}: {said['failed']}")
                if said["failed"] and keep is not None:
                    keep.mkdir(exist_ok=True)
                    path = Path(str(began["path"]))
                    shutil.copy(path, keep / f"{said['case']}{path.suffix}")
                began = {}
        if process.returncode:
            failures.append(f"{began or 'no case'}: the process ended with {process.returncode}")
            done += 1
    return done, failures


def _lines(process: "subprocess.Popen[str]") -> Iterator[str]:
    """What a process prints; one that prints nothing for long is ended."""
    assert process.stdout is not None
    while True:
        timer = threading.Timer(HUNG, process.kill)
        timer.start()
        line = process.stdout.readline()
        timer.cancel()
        if not line:
            return
        yield line


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--runs", type=int, default=10**9)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--keep", type=Path)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        write_seeds(Path(folder))
        done, failures = fuzz(
            Path(folder), seed=asked.seed, runs=asked.runs, seconds=asked.seconds, keep=asked.keep
        )
    for failure in failures:
        print(failure)
    print(f"{done} cases, {len(failures)} failed")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT))
    if sys.argv[1:2] == ["--work"]:
        place, seed, first, stop, runs = sys.argv[2:]
        work(Path(place), int(seed), int(first), float(stop), int(runs))
        sys.exit()
    sys.exit(main())
