"""Frames and conventions as whole hypotheses: recordings of machines, each read in one wrong way.

`python tests/conventions/frames_panel.py [--draws 240] [--seed 1] [--json FILE]` flies the shipped
machines, records what a lab would (attitude, gyro, accelerometer, magnetometer, wheels, some of
them absent), reads each recording wrongly in one way, or rightly, and prints the table.

A mistake is named rightly if the log put right is the right log, or if several readings are given
and the true one is among them (counted apart). Advice is what is given as sure. Where the streams
that are left cannot show a mistake, it is counted apart: nothing false may be said of it.
"""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from papers.flown import flown, perfect
from twin import rotation
from twin.controller import load_controller
from twin.conventions import convention_advice, corrected
from twin.conventions.correction import (
    TURNED,
    angle_changes,
    angles_of,
    attitude_of,
    axes_change,
    frames_of,
    signed_permutations,
)
from twin.conventions.evidence import ConventionFinding
from twin.noise import noise_of
from twin.plant.initial import InitialState
from twin.plant.truth import specific_force
from twin.platform import Platform, Sensor, load_platform
from twin.recording import Recording, Series
from twin.reference import Hold, Multisine, Reference, Slew

Array = NDArray[np.float64]

LAWS = {
    "sads": ("quaternion_pd", "free_float"),
    "cubesat": ("free_float",),
    "tas2": ("cmg_pd", "free_float"),
    "whorl1": ("quaternion_pd", "free_float"),
    "whorl2": ("quaternion_pd", "free_float"),
    "astros": ("free_float",),
    "dfki_pendulum": ("free_float",),
}
"""Machines, and the laws that move them."""
GRADES = {"fine": (1e-4, 1e-4), "middle": (1e-3, 1e-3), "coarse": (4.4e-3, 1e-2)}
"""White noise of gyro [rad/s] and attitude [rad]."""
KINDS = (
    *("frame", "mirror", "angle_sign", "angle_order", "right"),
    *("gravity_as_gyro", "other_gyro"),
)
"""Ways to read a log."""
STRANGE = ("gravity_as_gyro", "other_gyro")
"""Those in which a stream is no measurement of this motion at all."""
RUNS = 6
"""Recordings of one flight."""
FIELD = np.array([2.0e-5, 0.0, -4.3e-5])
"""Of the earth [T], where a machine states none."""
SITE = np.array([0.02, 0.01, -0.4])
"""Where a lab straps an IMU to the rod of a pendulum [m]."""
LATENCY = 0.04
"""The stamps of every stream are late by up to this [s]."""
SWINGS = 3.0
"""Times its noise by which a stream must swing otherwise for a mistake to be seen at all."""
ASKEW = 1.0
"""What an accelerometer that is mounted askew may be off by throughout [m/s^2]."""


@dataclass(frozen=True)
class Case:
    """A recording read in one way, and what is right."""

    right: Recording
    read: Recording
    platform: Platform | None
    kind: str
    words: str
    """What is wrong, as it should be said; empty of a right log and of a wrong signal."""
    visible: bool
    """Whether the streams that the log has can show the mistake."""


@dataclass(frozen=True)
class Row:
    """What was said of one case."""

    seed: int
    machine: str
    flight: str
    kind: str
    streams: str
    words: str
    visible: bool
    verdict: str
    sentences: tuple[str, ...]
    log_toml: str
    parted: str
    """Streams that the advice moves further apart."""


def main() -> int:
    """Fly, check and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--draws", type=int, default=240)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    rows = list[Row]()
    for row in draws(options.seed, options.draws):
        rows.append(row)
        if options.json:
            options.json.write_text(json.dumps([asdict(one) for one in rows], indent=1))
    print(table(rows))
    return 0


def draws(seed: int, count: int) -> Iterator[Row]:
    """Rows of so many cases, machine after machine; one seed a flight."""
    names = list(LAWS)
    for flight in range(-(-count // RUNS)):
        machine = names[flight % len(names)]
        yield from fly_and_check(machine, 1000 * seed + flight, min(RUNS, count - flight * RUNS))


def fly_and_check(machine: str, seed: int, count: int = RUNS) -> Iterator[Row]:
    """One flight of a machine: its runs, each read in a way of its own."""
    draw = np.random.default_rng(seed)
    platform, logs, flight = _flights(machine, draw)
    for log in logs[:count]:
        case = _case(log, None if machine == "dfki_pendulum" else platform, draw)
        yield _row(case, seed, machine, flight)


def _row(case: Case, seed: int, machine: str, flight: str) -> Row:
    advice = convention_advice(case.read, case.platform)
    findings = list(advice.findings)
    mended = corrected(case.read, findings)
    said = verdict(case, findings, mended)
    # on an arm that swings, an accelerometer is upright in a reading that does not lean
    apart = [] if said == "named" else parted(case.read, mended)
    return Row(
        seed,
        machine,
        flight,
        case.kind,
        " ".join(case.read),
        case.words,
        case.visible,
        said,
        tuple(finding.sentence for finding in findings),
        advice.log_toml,
        " ".join(apart),
    )


def verdict(case: Case, findings: list[ConventionFinding], mended: Recording) -> str:
    """`named`; `tied` with others; `wrong`, given as sure; `other`: the truth is not among several;
    `missed`. Of a right log `quiet`, `doubted` or `wrong`."""
    sure = [finding for finding in findings if not finding.ambiguous]
    correcting = [finding for finding in sure if finding.kind != "no_fit"]
    refused = any(finding.kind == "no_fit" and finding.stream == "gyro" for finding in sure)
    if case.kind in STRANGE:
        return "wrong" if correcting else "named" if refused else "tied" if findings else "missed"
    if len(correcting) < len(sure):
        return "wrong"
    if not findings:
        return "missed" if case.words else "quiet"
    if correcting and len(correcting) == len(findings):
        return "named" if case.words and same(mended, case.right) else "wrong"
    told = list(readings([finding for finding in findings if finding.ambiguous]))
    if not case.words:
        return "wrong" if correcting else "doubted"
    if correcting:
        return "wrong"
    return "tied" if case.words in told else "other"


def readings(findings: list[ConventionFinding]) -> Iterator[str]:
    """Every reading that is given, in words."""
    for others in dict.fromkeys(finding.alternatives for finding in findings):
        together = [f.correction.words for f in findings if f.alternatives == others]
        yield ", and ".join(together)
        yield from others


def same(one: Recording, other: Recording) -> bool:
    """Whether both show the same motion in the same axes."""
    for name in TURNED:
        if name not in one:
            continue
        a, b = one[name].value, other[name].value
        if name == "attitude":
            b = b * np.sign(np.sum(a * b, axis=1, keepdims=True))
        if not np.allclose(a, b, atol=1e-6 * float(np.abs(b).max())):
            return False
    return True


def parted(before: Recording, after: Recording) -> list[str]:
    """Pairs of streams that are further apart after the advice than before: by a tenth, and by
    more than noise makes."""
    old, new = _distances(before), _distances(after)
    return [pair for pair in new if new[pair] > 1.1 * old[pair] + 0.02]


def _distances(log: Recording) -> Mapping[str, float]:
    """How far apart streams are, from their samples: of rates relative to the motion, of the
    vertical in rad."""
    if "attitude" not in log:
        return {}
    attitude, found = log["attitude"], dict[str, float]()
    step = max(int(0.5 * attitude.rate), 1)
    time, q = attitude.time[::step], rotation.continuous(attitude.value)[::step]
    if "gyro" in log:
        turn = rotation.multiply(rotation.conjugate(q[:-1]), q[1:])
        rate = rotation.to_rotation_vector(turn) / np.diff(time)[:, None]
        gyro = _averaged(log["gyro"], time)
        off = gyro - rate
        off = off - off.mean(axis=0)
        size = np.sqrt(np.mean(np.square(rate - rate.mean(axis=0)))) + 1e-12
        found["gyro"] = float(np.sqrt(np.mean(np.square(off))) / size)
    if "accelerometer" in log:
        between = rotation.normalized(q[1:] + q[:-1])
        felt = rotation.rotate(between, _averaged(log["accelerometer"], time))
        lean = np.arctan2(np.hypot(felt[:, 0], felt[:, 1]), felt[:, 2])
        found["accelerometer"] = float(np.median(lean))
    return found


def _averaged(series: Series, edges: Array) -> Array:
    """(n, k) means between n + 1 edges [s]."""
    sums = np.cumsum(np.vstack([np.zeros(series.value.shape[1]), series.value]), axis=0)
    first, last = np.searchsorted(series.time, edges[:-1]), np.searchsorted(series.time, edges[1:])
    return (sums[last] - sums[first]) / np.maximum(last - first, 1)[:, None]


# flights


def _flights(machine: str, draw: np.random.Generator) -> tuple[Platform, list[Recording], str]:
    """A machine as shipped, recordings of one that differs a little, and how it flew."""
    shipped = load_platform(machine)
    if machine == "dfki_pendulum":
        return shipped, [_as_recorded(log, draw) for log in _swings(shipped, draw)], "swings"
    grade = str(draw.choice(list(GRADES)))
    platform = _with_sensors(shipped, draw, grade)
    law = str(draw.choice(LAWS[machine]))
    free = law == "free_float"
    duration = float(draw.uniform(40.0, 80.0))
    reference, motion = _reference(draw, free, platform)
    lean = np.radians(min(4.0, 0.5 * np.degrees(platform.tilt_limit)))
    start = InitialState(
        attitude=rotation.from_euler_zyx(
            draw.uniform(-3.0, 3.0, RUNS) * free,
            *(draw.uniform(-lean, lean, (2, RUNS)) * free),
        ),
        rate_body=np.radians(draw.uniform(-1.0, 1.0, (RUNS, 3)) * [0.5, 0.5, 3.0]) * free,
    )
    logs = flown(
        platform,
        load_controller(law),
        duration,
        start=start,
        reference=reference,
        runs=range(RUNS),
        seed=int(draw.integers(2**31)),
        record=True,
    ).recordings
    return shipped, [_as_recorded(log, draw) for log in logs], f"{law} {motion} {grade}"


def _reference(draw: np.random.Generator, free: bool, platform: Platform) -> tuple[Reference, str]:
    if free:
        return Hold(), "free"
    lean = min(np.radians(8.0), 0.5 * platform.tilt_limit)
    if draw.random() < 0.5:
        amplitude = draw.uniform(0.5, 1.0) * lean
        return Multisine(amplitude, draw.uniform(0.01, 0.03), 8.0), "multisine"
    roll, pitch = draw.uniform(-0.7, 0.7, 2) * lean
    yaw = np.radians(draw.choice([-1.0, 1.0]) * draw.uniform(30.0, 120.0))
    return Slew(roll, pitch, yaw, np.radians(draw.uniform(2.0, 6.0))), "slew"


def _with_sensors(shipped: Platform, draw: np.random.Generator, grade: str) -> Platform:
    """Sensors of a grade, with the biases that they have in a lab, J off by 4 %, hanging a little
    lower than stated."""
    gyro, attitude = GRADES[grade]
    field = shipped.magnetic_field if np.any(shipped.magnetic_field) else FIELD
    sensors = dict(shipped.sensors)
    for name, noise, bias, site in (
        ("gyro", gyro, 2.0 * gyro, ""),
        ("attitude", attitude, 0.0, ""),
        ("accelerometer", 0.03, 0.05, "imu"),
        ("magnetometer", 0.005 * np.linalg.norm(field), 0.05 * np.linalg.norm(field), ""),
    ):
        rate = sensors[name].rate if name in sensors else 50.0
        sensor = Sensor(name, rate, np.full(3, noise), np.zeros(3), site=site)
        sensors[name] = replace(sensor, bias=bias * draw.normal(size=3))
    inertia = shipped.inertia * (1.0 + 0.04 * draw.choice([-1.0, 1.0]))
    offset = shipped.center_of_mass_offset - [0.0, 0.0, shipped.mass * draw.uniform(0.0, 2e-4)]
    return replace(
        shipped,
        sensors=sensors,
        inertia=inertia,
        center_of_mass_offset=offset,
        magnetic_field=np.asarray(field),
    )


def _swings(shipped: Platform, draw: np.random.Generator) -> Iterator[Recording]:
    """An IMU on the rod of a pendulum that is let go, at several angles."""
    angle = draw.uniform(0.2, 1.2, (RUNS, 1)) * draw.choice([-1.0, 1.0], (RUNS, 1))
    coarser = replace(shipped, step=0.005, control_rate=100.0)
    flights = flown(
        perfect(coarser),
        load_controller("free_float"),
        40.0,
        start=InitialState(joint_angle=angle),
        runs=range(RUNS),
        record=True,
    )
    for log in flights.recordings:
        yield _on_the_rod(log, shipped.gravity, draw)


def _on_the_rod(log: Recording, gravity: float, draw: np.random.Generator) -> Recording:
    """What sensors with noise and biases show there."""
    gyro, noise = GRADES[str(draw.choice(list(GRADES)))]
    time = log["joint_angle"].time
    angle, rate = log["joint_angle"].value[:, 0], log["joint_rate"].value[:, 0]
    about_x = np.array([1.0, 0.0, 0.0])
    attitude = rotation.from_rotation_vector(angle[:, None] * about_x)
    turning = np.gradient(rate, time)[:, None] * about_x
    up = np.broadcast_to([0.0, 0.0, gravity], (len(time), 3))
    felt = specific_force(attitude, up, rate[:, None] * about_x, turning, SITE)
    field = rotation.rotate(rotation.conjugate(attitude), np.broadcast_to(FIELD, felt.shape))
    shaken = rotation.from_rotation_vector(draw.normal(0.0, noise, felt.shape))
    values = {
        "gyro": (rate[:, None] * about_x + draw.normal(0.0, 2.0 * gyro, 3), gyro, "rad/s"),
        "accelerometer": (felt + draw.normal(0.0, 0.05, 3), 0.03, "m/s^2"),
        "magnetometer": (field + draw.normal(0.0, 2e-6, 3), 2e-7, "T"),
    }
    streams = {
        name: Series(time, value + draw.normal(0.0, sigma, felt.shape), ("x", "y", "z"), unit)
        for name, (value, sigma, unit) in values.items()
    }
    noisy = rotation.multiply(attitude, shaken)
    streams["attitude"] = Series(time, noisy, ("w", "x", "y", "z"), "1")
    return Recording(streams, {"kind": "log"})


def _as_recorded(log: Recording, draw: np.random.Generator) -> Recording:
    """What a lab keeps of a flight: stamps that are late, an accelerometer that is mounted askew,
    an attitude as a quaternion or as angles, and not every stream."""
    log = log.without_truth()
    streams = {
        name: replace(series, time=series.time + draw.uniform(0.0, LATENCY))
        for name, series in log.items()
        if name in (*TURNED, "wheel_speed") or name.startswith("command_wheel")
    }
    askew = rotation.from_rotation_vector(draw.normal(0.0, np.radians(1.0), 3))
    felt = streams["accelerometer"]
    streams["accelerometer"] = replace(felt, value=rotation.rotate(askew, felt.value))
    pair = [("attitude", "gyro"), ("attitude", "accelerometer"), ("gyro", "accelerometer")]
    pair += [("attitude", "magnetometer"), ("gyro", "magnetometer")]
    kept = list(pair[int(draw.choice(len(pair), p=[0.5, 0.15, 0.15, 0.1, 0.1]))])
    kept += [name for name in streams if name not in kept and draw.random() < 0.6]
    provenance = {**log.provenance, "kind": "log"}
    if "attitude" in kept and draw.random() < 0.5:
        layout = str(draw.choice(["zyx", "zyx", "xyz", "zxy"]))
        names = {"z": "yaw", "y": "pitch", "x": "roll"}
        facts = {"format": f"euler_{layout}", "columns": [names[one] for one in layout]}
        provenance["streams"] = {"attitude": facts}
    return Recording({name: one for name, one in streams.items() if name in kept}, provenance)


# ways to read them


def _case(right: Recording, platform: Platform | None, draw: np.random.Generator) -> Case:
    kinds = [kind for kind in KINDS if _possible(kind, right)]
    kind = str(draw.choice(kinds))
    mistakes: dict[str, Callable[[Recording, np.random.Generator], tuple[Recording, str]]] = {
        "frame": _z_down,
        "mirror": _left_handed,
        "angle_sign": _angle_signs,
        "angle_order": _angle_order,
        "gravity_as_gyro": _gravity_as_gyro,
        "other_gyro": _another_gyro,
        "right": lambda log, draw: (log, ""),
    }
    read, words = mistakes[kind](right, draw)
    return Case(right, read, platform, kind, words, _visible(kind, right, read, words))


def _possible(kind: str, log: Recording) -> bool:
    angles = "streams" in log.provenance
    if kind in ("angle_sign", "angle_order"):
        return angles
    if kind == "gravity_as_gyro":
        return "accelerometer" in log and "gyro" in log
    return kind != "other_gyro" or ("gyro" in log and "attitude" in log)


def _z_down(log: Recording, draw: np.random.Generator) -> tuple[Recording, str]:
    """Every stream in NED/FRD."""
    del draw
    down = np.array([1.0, -1.0, -1.0])
    streams = dict(log.streams)
    for name in TURNED:
        if name in log:
            turn = np.r_[1.0, down] if name == "attitude" else down
            streams[name] = replace(log[name], value=log[name].value * turn)
    read = replace(log, streams=streams)
    frames = frames_of(read)
    return read, frames[1].corrections[0].words if len(frames) > 1 else "z down"


def _left_handed(log: Recording, draw: np.random.Generator) -> tuple[Recording, str]:
    """One triad whose axes are a mirror image: an axis flipped, two swapped, or all flipped."""
    stream = str(draw.choice([name for name in TURNED[1:] if name in log]))
    plain = [-np.eye(3), *(axes for axes in signed_permutations(3) if _is_plain(axes))]
    axes = plain[int(draw.integers(len(plain)))]
    series = log[stream]
    value = series.value @ axes.T
    read = replace(log, streams={**log.streams, stream: replace(series, value=value)})
    change = axes_change(stream, axes.T + 0.0, series.columns)
    assert change is not None
    return read, change.words


def _is_plain(axes: Array) -> bool:
    """One axis flipped, or two swapped."""
    flipped, moved = int((axes < 0.0).sum()), int(3 - np.abs(np.diag(axes)).sum())
    return (flipped, moved) in ((1, 0), (0, 2))


def _angle_signs(log: Recording, draw: np.random.Generator) -> tuple[Recording, str]:
    signs = [np.diag(row) for row in ([-1, 1, 1], [1, -1, 1], [1, 1, -1], [-1, -1, -1])]
    return _with_angles(log, signs[int(draw.integers(len(signs)))])


def _angle_order(log: Recording, draw: np.random.Generator) -> tuple[Recording, str]:
    orders = [(2, 1, 0), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1)]
    return _with_angles(log, np.eye(3)[list(orders[int(draw.integers(len(orders)))])])


def _with_angles(log: Recording, axes: Array) -> tuple[Recording, str]:
    """The log whose file has `axes` (3, 3) times the angles that its format says."""
    sequence = str(log.provenance["streams"]["attitude"]["format"]).removeprefix("euler_").upper()
    angles = angles_of(log["attitude"].value, sequence, world_to_body=False) @ axes.T
    value = attitude_of(angles, sequence, world_to_body=False)
    streams = {**log.streams, "attitude": replace(log["attitude"], value=value)}
    right = axes.T.tolist()
    words = [c.words for c in angle_changes(log) if np.array(c.axes).tolist() == right]
    return replace(log, streams=streams), words[0]


def _gravity_as_gyro(log: Recording, draw: np.random.Generator) -> tuple[Recording, str]:
    del draw
    felt = log["accelerometer"]
    return replace(log, streams={**log.streams, "gyro": replace(felt, unit="rad/s")}), ""


def _another_gyro(log: Recording, draw: np.random.Generator) -> tuple[Recording, str]:
    """The gyro of another run, which moved as much, in its own way."""
    gyro = log["gyro"]
    count, size = len(gyro), float(np.std(gyro.value))
    tones = np.linspace(0.02, 1.0, 60)
    phase = draw.uniform(0.0, 2.0 * np.pi, (len(tones), 3))
    wave = np.sin(2.0 * np.pi * tones[:, None] * gyro.time[:count, None, None] + phase).sum(axis=1)
    other = 2.0 * size / np.std(wave) * wave + draw.normal(0.0, 0.1 * size, wave.shape)
    return replace(log, streams={**log.streams, "gyro": replace(gyro, value=other)}), ""


def _visible(kind: str, log: Recording, read: Recording, words: str) -> bool:
    """Whether the streams that are there can show the mistake, whoever looks at them.

    A frame turns all of them together, so that only gravity, which points down, tells it, and only
    beside an attitude. A mirrored triad is seen by a motion that it mirrors, and that of gravity by
    the vertical of an attitude too; all axes of a field turned round are the field of a room turned
    round, and so is gravity where no attitude has the vertical. Beside an accelerometer alone,
    wrong angles are seen by the vertical that they move: a yaw that turns first moves none.
    """
    if kind in STRANGE or kind == "right":
        return True
    if kind == "frame":
        return "attitude" in log and "accelerometer" in log
    if kind == "mirror":
        stream = next(name for name in TURNED[1:] if name in log and read[name] is not log[name])
        if "every axis" in words and stream != "gyro":
            return stream == "accelerometer" and "attitude" in log
        upright = stream == "accelerometer" and "attitude" in log
        return _moves_apart(log[stream], read[stream], upright=upright)
    return len([name for name in TURNED if name in log]) > 1 and _swings_apart(log, read)


def _moves_apart(right: Series, read: Series, *, upright: bool) -> bool:
    """Whether a mirrored triad moves otherwise than the right one does, by more than noise, or
    points another way than upright by more than its mounting."""
    off = read.value - right.value
    leans = upright and float(np.linalg.norm(off.mean(axis=0))) > ASKEW
    # over a second, for who looks may average: the noise is that of two axes or of twice one
    count = max(int(right.rate), 1)
    means = off[: len(off) // count * count].reshape(-1, count, off.shape[1]).mean(axis=1)
    noise = float(np.sqrt(np.mean(np.square(noise_of(right))))) * (2.0 / count) ** 0.5
    return leans or float(np.std(means, axis=0).max()) > SWINGS * noise


def _swings_apart(log: Recording, read: Recording) -> bool:
    """Whether what others see of wrong angles moves otherwise than of the right ones, by more than
    noise."""
    right = log["attitude"]
    noise = float(np.sqrt(np.mean(np.square(noise_of(right)))))
    if "gyro" not in log and "magnetometer" not in log:
        up, seen = (rotation.vertical_body(one["attitude"].value) for one in (log, read))
        return float(np.std(seen - up, axis=0).max()) > SWINGS * noise
    off = rotation.multiply(rotation.conjugate(right.value), read["attitude"].value)
    wander = rotation.to_rotation_vector(rotation.continuous(off))
    return float(np.std(wander, axis=0).max()) > SWINGS * noise


# what is printed


def table(rows: list[Row]) -> str:
    """Counts by kind, machine and streams; every failure in full."""
    seen = [row for row in rows if row.visible and row.kind != "right"]
    blind = [row for row in rows if not row.visible]
    right = [row for row in rows if row.kind == "right"]
    lines = [
        f"draws: {len(rows)} on {len({row.machine for row in rows})} machines",
        f"misread logs that show it: {_counts(seen)}",
        f"misread logs that cannot show it: {_counts(blind)}",
        f"right logs: {_counts(right)}",
        f"wrong advice given as sure: {sum(row.verdict == 'wrong' for row in rows)}",
        f"advice that moves streams further apart: {sum(bool(row.parted) for row in rows)}",
    ]
    for key in ("kind", "machine"):
        for value in dict.fromkeys(getattr(row, key) for row in seen):
            part = [row for row in seen if getattr(row, key) == value]
            lines.append(f"  {value}: {_counts(part)}")
    for row in rows:
        bad = row.visible and row.verdict in ("missed", "other")
        if bad or row.parted or row.verdict in ("wrong", "doubted"):
            said = " ".join(row.sentences) or "nothing"
            truth = row.words or row.kind
            lines.append(
                f"{row.verdict} ({row.seed}, {row.machine}, {row.flight}; {row.streams}) "
                f"{truth}: {said}" + (f" [parts {row.parted}]" if row.parted else "")
            )
    return "\n".join(lines)


def _counts(rows: list[Row]) -> str:
    names = ("named", "tied", "wrong", "other", "missed", "quiet", "doubted")
    count = {name: sum(row.verdict == name for row in rows) for name in names}
    good = count["named"] + count["tied"] + count["quiet"]
    told = ", ".join(f"{count[name]} {name}" for name in names if count[name])
    return f"{good} of {len(rows)} rightly ({told})"


if __name__ == "__main__":
    sys.exit(main())
