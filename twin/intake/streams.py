"""Which streams a table holds: groups of columns by their names, their kind by name and content."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.conventions.grid import counts_in
from twin.intake.tables import DataTable
from twin.platform import Platform
from twin.recording.column_names import stated_unit, without_unit
from twin.signals import STREAMS
from twin.units import STANDARD_GRAVITY, known_unit, unit_named

Array = NDArray[np.float64]


@dataclass
class Proposal:
    """A stream of a log, as log.toml would have it, and why."""

    stream: str
    table: DataTable
    columns: tuple[str, ...]
    """With a minus before those that are turned about."""
    keys: dict[str, str] = field(default_factory=dict[str, str])
    """Further keys of log.toml, each a TOML value."""
    reasons: list[str] = field(default_factory=list[str])
    unsure: list[str] = field(default_factory=list[str])
    """What a person should look at."""
    left_out: str = ""
    """Why it is not taken; empty where it is."""


_KINDS = (
    (
        "wheel_speed",
        r"(wheel|rotor|rw|motor)\w*[ _.]*(speed|rate|vel|rpm|omega)|^rpm|(^|[._])rw\d*$",
    ),
    ("command_wheel_torque", r"(wheel|rw)\w*[ _.]*(cmd|command|torque)|(cmd|command)\w*(wheel|rw)"),
    ("stage_position", r"(stage|mass|slider|carriage)\w*[ _.]*(pos|position)"),
    (
        "gyro",
        r"gyr|ang(ular)?[ _.]*(vel|rate)|angular$|rot\w*[ _.]*(rate|vel)"
        r"|(^|[._])(omega|w|rate|rates|g|xyz)$",
    ),
    ("accelerometer", r"acc|specific[ _.]*force|(^|[._])a$"),
    ("magnetometer", r"mag|(^|[._])(m|b)$"),
    ("attitude", r"quat|orient|attitude|(^|[._ ])(q|rot|mat|r|euler|pose|rotation)$|^$"),
    ("velocity", r"(lin(ear)?[ _.]*)?vel|twist\.linear$|(^|[._])v$"),
    ("position", r"pos|transl|(^|[._ ])(t|p|xyz)$|origin|^$"),
)
"""Stream -> what the common part of its columns' names is like, the surest first."""
_SKIPPED = (
    r"free[ _.]?acc|user[ _.]?acc|gravity|dv|dq|delta|covariance|residual|error|std|target"
    r"|reference|setpoint|raw|(^|[._ ])des(ired)?($|[._ ])"
)
"""Names that look like a sensor's and are none."""

UNIT_BY_SIZE = "its unit, which is by its size alone"
_COUNTS = tuple((f"1 / {full}", float(full)) for full in (16384, 8192, 4096, 2048, 1024))
"""Counts of one g of an accelerometer of 16 bits with a range of 2, 4, 8, 16 or 32 g."""
FREE = 0.5
"""An accelerometer that shows less than this, at the median, has gravity taken out [g]."""
_AXES = ("x", "y", "z")
_LETTERS = {
    "w": "gyro",
    "g": "gyro",
    "a": "accelerometer",
    "m": "magnetometer",
    "b": "magnetometer",
}
_ANGLES = {
    "yaw": ("yaw", "heading", "psi"),
    "pitch": ("pitch", "theta"),
    "roll": ("roll", "phi"),
}


def streams_among(
    table: DataTable, clock: str | None, platform: Platform | None = None
) -> list[Proposal]:
    """The streams in a table.

    Args:
        table: whose columns.
        clock: the column of its times, which is none of them.
        platform: the machine; that of a hinge has an angle, a rate and a torque.
    """
    names = [name for name in table.names if name != clock and name not in table.file.clocks]
    result: dict[str, Proposal] = {}
    for proposal in (
        *_quaternions(table, names),
        *_matrices(table, names),
        *_angles(table, names),
        *_triads(table, names),
        *_turn_rates(table, names),
        *_parts(table, names, platform),
        *(_of_hinge(table, names) if platform is not None and _hinged(platform) else ()),
    ):
        result.setdefault(proposal.stream, proposal)
    return list(result.values())


def _plain(name: str) -> str:
    """A name without the unit at its end; `q[0]` is `q.0`, MAVLink's `xgyro` is `gyro_x`."""
    if not name.endswith(("]", ")")):
        name = without_unit(name)
    name = re.sub(r"^([xyz])(gyro|acc|mag)$", r"\2_\1", name)
    without = re.sub(r"\s*[\[(](?!\d+[\])])[^\[\]()]*[\])]\s*$", "", name).strip()
    return re.sub(r"\[(\d+)\]$", r".\1", without)


def _groups(names: Sequence[str], endings: Sequence[str]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Stem and columns of each group whose names end so: gyro_x, gyro_y, gyro_z; wx, wy, wz.

    Of numbered columns only whole groups: the first three of nine are no vector.
    """
    stems: dict[str, dict[str, str]] = {}
    numbered: dict[str, int] = {}
    for name in names:
        plain = _plain(name)
        if (result := re.match(r"(.*?)[ _.-]*\d+$", plain)) is not None:
            numbered[result[1].lower()] = numbered.get(result[1].lower(), 0) + 1
        for ending in endings:
            stem = _stem(plain, ending)
            if stem is not None:
                stems.setdefault(stem.lower(), {}).setdefault(ending, name)
    for stem, columns in stems.items():
        too_many = endings[0].isdigit() and numbered.get(stem, 0) > len(endings)
        if len(columns) == len(endings) and not too_many:
            yield stem, tuple(columns[ending] for ending in endings)


def _stem(name: str, ending: str) -> str | None:
    """What stands before an ending that is a part of its own, or round a word that is one;
    None where the name has neither: `gyro_x`, `qx`, `X Gyro` and `Gyro_X_CAL`."""
    if not name.lower().endswith(ending):
        words = re.split(r"[^A-Za-z0-9]+", name)
        if [word.lower() for word in words].count(ending) != 1 or not ending.isalpha():
            return None
        return " ".join(word for word in words if word.lower() != ending)
    stem = name[: len(name) - len(ending)]
    separated = not stem or not stem[-1].isalnum()
    word = re.split(r"[ _.:-]", stem)[-1]
    lettered = len(word) == 1 or stem[-1:].islower() != name[-len(ending) :].islower()
    short = len(word) <= 5 and ending.isalpha()
    if separated or lettered or short or ending.isdigit():
        return stem.rstrip(" _.-[(")
    return None


def _quaternions(table: DataTable, names: Sequence[str]) -> Iterator[Proposal]:
    named = "by the names of its parts"
    for endings, how in (
        (("w", *_AXES), named),
        (("r", "i", "j", "k"), named),
        (("s", *_AXES), named),
        (("0", "1", "2", "3"), ""),
        (("1", "2", "3", "4"), ""),
    ):
        for stem, columns in _groups(names, endings):
            values = table.columns(columns)
            if values is None:
                continue
            length = np.linalg.norm(values, axis=1)
            length = length[length > 0.0]
            if not len(length) or np.median(np.abs(length - 1.0)) > 0.02:
                continue
            if re.search(_SKIPPED, stem):
                continue
            reason = f"{', '.join(columns)}: of unit length, so a quaternion"
            unsure: list[str] = []
            ordered = columns
            if how:
                reason += f", {how}"
            else:
                first, last = np.abs(values[:, 0]).mean(), np.abs(values[:, 3]).mean()
                reason += ", its scalar first"
                if last > first and not table.type and "q0" not in "".join(columns).lower():
                    ordered = (columns[3], *columns[:3])
                    reason = reason.replace("first", "last, which is the larger")
                    unsure.append("whether the scalar stands first or last")
            yield Proposal("attitude", table, ordered, {}, [reason], unsure)


def _matrices(table: DataTable, names: Sequence[str]) -> Iterator[Proposal]:
    """Nine numbers whose rows are square to each other."""
    stems: dict[str, list[tuple[str, str]]] = {}
    for name in names:
        result = re.match(r"(.*?)[ _.]*((?:\[\d\])+|\d\d|\d)$", name)
        if result:
            stems.setdefault(result[1].lower(), []).append((result[2], name))
    for columns in stems.values():
        if len(columns) != 9:
            continue
        listed = tuple(name for _, name in columns)
        values = table.columns(listed)
        if values is None:
            continue
        matrix = values.reshape(-1, 3, 3)
        off = np.abs(matrix @ matrix.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
        if np.median(off) > 0.02:
            continue
        marks = [re.findall(r"\d", mark) for mark, _ in columns]
        places = {(m[0], m[1]): name for m, name in zip(marks, listed, strict=True) if len(m) == 2}
        if len(places) == 9:
            rows = sorted({row for row, _ in places})
            ordered = tuple(places[row, column] for row in rows for column in rows)
            reason, unsure = "nine entries of a rotation, by their rows and columns", list[str]()
        else:
            # Qualisys writes a matrix column by column
            ordered = tuple(listed[3 * column + row] for row in range(3) for column in range(3))
            reason = "nine entries of a rotation, numbered column by column"
            unsure = [
                "whether the matrix is numbered by columns or by rows (then the body turns back)"
            ]
        yield Proposal("attitude", table, ordered, {"format": '"matrix"'}, [reason], unsure)


def _euler(table: DataTable, columns: Sequence[str], values: Array) -> Proposal:
    """Yaw, pitch and roll."""
    proposal = Proposal("attitude", table, tuple(columns), {"format": '"euler_zyx"'})
    proposal.reasons.append(f"{', '.join(columns)}: Euler angles")
    steep = float(np.abs(values[:, 1]).max()) > 0.5 * np.pi  # no pitch is, in rad
    _unit(proposal, values, (("deg", 0.0 if steep else 6.5), ("rad", 0.0)))
    if not _texts(proposal) and not steep and "unit" not in proposal.keys:
        proposal.unsure.append("whether the angles are in rad")
    proposal.unsure.append("the order in which the angles turn, and their signs")
    return proposal


def _angles(table: DataTable, names: Sequence[str]) -> Iterator[Proposal]:
    """Yaw, pitch and roll, or a rotation vector."""
    plain = {_plain(name).lower(): name for name in names}
    yaws = [(text, word) for text in plain for word in _ANGLES["yaw"] if text.endswith(word)]
    for text, word in yaws:
        stem = text.removesuffix(word)
        parts = [[plain.get(f"{stem}{item}") for item in words] for words in _ANGLES.values()]
        result = [next((name for name in part if name), None) for part in parts]
        columns = tuple(name for name in result if name)
        values = table.columns(columns) if len(columns) == 3 else None
        if values is None or re.search(_SKIPPED, stem):
            continue
        proposal = _euler(table, columns, values)
        if word == "heading":
            proposal.unsure.append("whether the axes are NED, for a heading counts clockwise")
        yield proposal
    for stem, (x, y, z) in _groups(names, _AXES):
        if not re.search(r"euler([ _.]?angles?)?$", stem):
            continue
        values = table.columns((x, y, z))
        if values is None:
            continue
        # Movella: roll, pitch, yaw from -180 to 180; Bosch: heading from 0 to 360, roll, pitch
        heading = float(values[:, 0].min()) >= 0.0 and float(values[:, 0].max()) > 180.0
        columns = (x, z, y) if heading else (z, y, x)
        proposal = _euler(table, columns, values)
        proposal.reasons.append(
            f"{', '.join(columns)} for yaw, pitch and roll, "
            + ("for the first runs to 360 deg" if heading else "as Movella has X, Y and Z")
        )
        yield proposal
    for _, columns in _groups(names, ("rx", "ry", "rz")):
        values = table.columns(columns)
        if values is None or table.keys.get("variable") == "Joints":  # angles between two bodies
            continue
        proposal = Proposal("attitude", table, columns, {"format": '"rotation_vector"'})
        proposal.reasons.append("RX, RY, RZ: a rotation vector, as Vicon exports it")
        _unit(proposal, values, (("deg", 6.5), ("rad", 0.0)))
        yield proposal


def _triads(table: DataTable, names: Sequence[str]) -> Iterator[Proposal]:
    groups = [
        *_groups(names, _AXES),
        *_groups(names, ("0", "1", "2")),
        *_groups(names, ("1", "2", "3")),
    ]
    for stem, columns in groups:
        values = table.columns(columns)
        if values is None or re.search(_SKIPPED, stem):
            continue
        kind = _LETTERS.get(stem) or _kind(stem) or _kind(table.keys.get("topic", ""))
        if not kind and not stem:
            posed = any(True for _ in _quaternions(table, names))
            # programs of phones write a file a sensor
            kind = "position" if posed else _kind(table.file.path.stem)
        if not kind and table.preamble and stem:  # motion capture names them after the body
            kind = "position"
        text = next((t for name in columns if (t := table.unit(name) or stated_unit(name))), "")
        if kind == "accelerometer" and text == "G":
            text = "g"  # a gauss measures no acceleration
        kind = _kind_of_unit(kind, text)
        if kind not in STREAMS or STREAMS[kind].columns != _AXES:
            continue
        proposal = Proposal(kind, table, columns)
        proposal.reasons.append(f"{', '.join(columns)}: named as {kind}")
        length = float(np.median(np.linalg.norm(values, axis=1)))
        if kind == "accelerometer":
            _of_accelerometer(proposal, values, length)
        elif kind == "magnetometer":
            _unit_by_length(
                proposal,
                length,
                (("T", 5e-5), ("uT", 50.0), ("G", 0.5), ("mG", 500.0), ("nT", 5e4)),
                off=1.0,
            )
        elif kind == "gyro":
            _unit(proposal, values, (("deg/s", 35.0), ("rad/s", 0.0)))
            if not text:
                proposal.unsure.append(UNIT_BY_SIZE)
                if _are_counts(values):
                    proposal.left_out = (
                        "whole numbers without a unit, so counts of the sensor: state in log.toml "
                        "their `scale`, the rad/s of one count, by its data sheet"
                    )
        else:
            _unit(proposal, values, (("mm", 20.0), ("m", 0.0)))
        yield proposal


def _turn_rates(table: DataTable, names: Sequence[str]) -> Iterator[Proposal]:
    """Rates that are called after the angles: `rollRate`, `pitchRate`, `yawRate`."""
    for word in ("rate", "speed"):
        plain = {re.sub(r"[ _.-]", "", _plain(name)).lower(): name for name in names}
        columns = tuple(plain.get(f"{angle}{word}", "") for angle in ("roll", "pitch", "yaw"))
        values = table.columns(columns) if all(columns) else None
        if values is None:
            continue
        proposal = Proposal("gyro", table, columns)
        proposal.reasons.append(
            f"{', '.join(columns)}: rates about the body's axes, by their names"
        )
        proposal.unsure.append("whether they are rates about the body's axes, or of the angles")
        _unit(proposal, values, (("deg/s", 35.0), ("rad/s", 0.0)))
        if not _texts(proposal):
            proposal.unsure.append(UNIT_BY_SIZE)
        yield proposal


def _of_accelerometer(proposal: Proposal, values: Array, length: float) -> None:
    """The unit in which gravity has its size, or the counts of one g; without gravity, no unit."""
    counts = [(text, full) for text, full in _COUNTS if abs(length / full - 1.0) < 0.1]
    stated = _texts(proposal)
    thousand = abs(length / 1000.0 - 1.0) < abs(length / 1024.0 - 1.0)
    if not stated and counts and counts[0][1] == 1024.0:
        proposal.unsure.append("whether 1000 or 1024 of it are one g, which are 2 % apart")
    if not stated and counts and _are_counts(values) and not (thousand and counts[0][1] == 1024.0):
        proposal.keys["unit"] = '"g"'
        proposal.keys["scale"] = f"{1.0 / counts[0][1]!r}"
        proposal.reasons.append(f"{length:.0f} long, in whole numbers: {counts[0][1]:.0f} a g")
        return
    if stated == "G":
        proposal.keys["unit"] = '"g"'
        proposal.reasons.append("in G, which is g here")
    else:
        _unit_by_length(proposal, length, (("m/s^2", STANDARD_GRAVITY), ("g", 1.0), ("mg", 1e3)))
    unit = proposal.keys.get("unit", '"m/s^2"').strip('"')
    known = known_unit(unit)
    if known is not None and length * known.factor < FREE * STANDARD_GRAVITY:
        proposal.left_out = (
            f"{length:.3g} {unit} long, so without gravity, which an accelerometer on the ground "
            "shows"
        )


def _are_counts(values: Array) -> bool:
    """Whether numbers are those of a converter: whole, and many different ones."""
    whole = bool((values == np.round(values)).all())
    return whole and len(np.unique(values)) > 20


def _parts(table: DataTable, names: Sequence[str], platform: Platform | None) -> Iterator[Proposal]:
    """Streams with one column a part of the machine: wheels, stages. The column of an only wheel
    needs no number."""
    single = platform is not None and len(platform.wheels) == 1
    for kind in ("wheel_speed", "command_wheel_torque", "stage_position"):
        pattern = next(p for name, p in _KINDS if name == kind)
        named = tuple(
            name
            for name in names
            if re.search(pattern, _plain(name), re.IGNORECASE)
            and not re.search(_SKIPPED, name, re.IGNORECASE)
        )
        numbered = r"\d|[xyz]$|left|right"
        columns = tuple(name for name in named if re.search(numbered, _plain(name), re.IGNORECASE))
        if not columns and single and len(named) == 1 and _is_of_wheel(kind, named[0]):
            columns = named
        values = table.columns(columns) if columns else None
        if values is None:
            continue
        proposal = Proposal(kind, table, columns)
        proposal.reasons.append(f"{', '.join(columns)}: named as {kind}")
        sizes = {"wheel_speed": (("rad/s", 0.0),), "stage_position": (("mm", 1.0), ("m", 0.0))}
        if kind == "wheel_speed" and any("rpm" in name.lower() for name in columns):
            sizes["wheel_speed"] = (("rpm", 0.0),)
        _unit(proposal, values, sizes.get(kind, (("N m", 0.0),)))
        if len(columns) > 1:
            proposal.unsure.append("the order of the machine's parts")
        yield proposal


def _is_of_wheel(kind: str, name: str) -> bool:
    """Whether a column is a wheel's speed, or its torque: a command may be a duty."""
    torque = kind == "command_wheel_torque" and re.search("torque", name, re.IGNORECASE) is not None
    return kind == "wheel_speed" or torque


TURNS = 40.0
"""Angles of a hinge beyond are in degrees, for in rad it would have turned round six times."""
_HINGE = (
    ("joint_angle", r"angle|pos(ition)?$|theta|phi$", (("deg", TURNS), ("rad", 0.0))),
    (
        "joint_rate",
        r"rate|vel(ocity)?$|speed|omega|gyro|^[gw]_?[xyz]$",
        (("deg/s", 35.0), ("rad/s", 0.0)),
    ),
    ("command_joint_torque", r"torque|tau|effort", (("N m", 0.0),)),
)
"""Stream of a hinge -> what its column is called, and units by size."""
_OF_PARTS = ("wheel_speed", "command_wheel_torque", "stage_position")


def _hinged(platform: Platform) -> bool:
    return platform.base.kind == "hinge"


def hinged_among(table: DataTable) -> bool:
    """Whether a table has columns that are called as an angle and a rate of one hinge are."""
    found = {proposal.stream for proposal in _of_hinge(table, table.names)}
    return {"joint_angle", "joint_rate"} <= found


def _of_hinge(table: DataTable, names: Sequence[str]) -> Iterator[Proposal]:
    for kind, pattern, sizes in _HINGE:
        named = [name for name in names if re.search(pattern, _plain(name), re.IGNORECASE)]
        good = [
            name
            for name in named
            if not re.search(_SKIPPED, name, re.IGNORECASE) and _kind(_plain(name)) not in _OF_PARTS
        ]
        like = table.columns(good) if kind == "joint_rate" and len(good) > 1 else None
        if like is not None:
            # of a sensor's axes, the hinge turns one
            most = good[int(np.argmax(like.std(axis=0)))]
            good = [most, *(name for name in good if name != most)]
        values = table.columns(good[:1]) if good else None
        if values is None:
            continue
        proposal = Proposal(kind, table, (good[0],))
        most = ", and turns most of its like" if like is not None else ""
        proposal.reasons.append(f"{good[0]}: named as {kind}{most}")
        counts = {turn: counts_in(values[:, 0], turn) for turn in (360.0, 2.0 * np.pi)}
        if kind == "joint_angle" and not _texts(proposal) and counts[360.0] > counts[2.0 * np.pi]:
            proposal.keys["unit"] = '"deg"'
            proposal.reasons.append(f"of {counts[360.0]} counts a turn: in deg")
        else:
            _unit(proposal, values, sizes)
            sure = _texts(proposal) or (kind == "joint_angle" and any(counts.values()))
            if kind != "command_joint_torque" and not sure:
                proposal.unsure.append(UNIT_BY_SIZE)
        if len(good) > 1:
            proposal.unsure.append(f"whether it is {good[0]}, or {', '.join(good[1:4])}")
        yield proposal


def _kind(stem: str) -> str:
    """The stream whose columns have such a name in common; empty for none."""
    kinds = (kind for kind, pattern in _KINDS if re.search(pattern, stem, re.IGNORECASE))
    return next(kinds, "") if stem else ""


def _kind_of_unit(kind: str, text: str) -> str:
    """What a stated unit says of a kind: accelerations are no angular rates."""
    unit = known_unit(text) if text else None
    si = unit.si if unit is not None else ""
    by_unit = {"rad/s": "gyro", "m/s^2": "accelerometer", "T": "magnetometer", "m": "position"}
    if si in by_unit and (not kind or (kind in STREAMS and STREAMS[kind].unit != si)):
        return by_unit[si]
    return kind


def _unit(proposal: Proposal, values: Array, sizes: Sequence[tuple[str, float]]) -> None:
    """The unit that stands by a column, or the one that its largest value is possible in."""
    if _stated(proposal):
        return
    largest = float(np.abs(values).max())
    unit = next(unit for unit, least in sizes if largest >= least)
    if unit_named(unit).factor != 1.0:
        proposal.keys["unit"] = f'"{unit}"'
        proposal.reasons.append(f"up to {largest:.3g}: in {unit}")


def _unit_by_length(
    proposal: Proposal, length: float, sizes: Sequence[tuple[str, float]], off: float = 0.4
) -> None:
    """The unit in which a vector has the length that it must have."""
    if _stated(proposal) or length <= 0.0:
        return
    near = [(unit, abs(np.log(length / usual))) for unit, usual in sizes]
    unit, distance = min(near, key=lambda item: item[1])
    if distance > off:
        proposal.unsure.append(f"its unit: it is {length:.3g} long")
    elif unit_named(unit).factor != 1.0:
        proposal.keys["unit"] = f'"{unit}"'
        proposal.reasons.append(f"{length:.3g} long: in {unit}")


def _texts(proposal: Proposal) -> str:
    """The unit's text that the file states beside one of the columns."""
    texts = [proposal.table.unit(name) or stated_unit(name) for name in proposal.columns]
    return next((text for text in texts if text), "")


def _stated(proposal: Proposal) -> bool:
    """Whether the file states the unit, which is then taken over."""
    text = _texts(proposal)
    if not text:
        return False
    unit = known_unit(text)
    if unit is None:
        proposal.unsure.append(f"its unit, which the file calls {text!r}")
        return False
    if unit.factor != 1.0 or unit.offset:
        proposal.keys["unit"] = f'"{text}"'
    proposal.reasons.append(f"in {text}, by the file")
    return True
