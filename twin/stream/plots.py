"""What a person wants to see plotted, from the streams: degrees, millimetres, limits, torques."""

from collections.abc import Iterator, Mapping

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from twin import rotation
from twin.platform import Platform
from twin.recording.rrd import PALETTE

Array = NDArray[np.float64]
Rows = Mapping[str, tuple[Array, Array]]

SAID = "plots/said"
TILT = "plots/tilt"
ATTITUDE = "plots/attitude"
ATTITUDE_ERROR = "plots/attitude_error"
RATE = "plots/rate"
WHEEL_SPEED = "plots/wheel_speed"
STAGE_POSITION = "plots/stage_position"
GRAVITY_TORQUE = "plots/gravity_torque"
JOINT_ANGLE = "plots/joint_angle"
JOINT_RATE = "plots/joint_rate"
JOINT_TORQUE = "plots/joint_torque"

_LIMIT = (150, 150, 150)


class Plots:
    """Derived series of one platform; a stream's last value is held for the rows to come."""

    def __init__(self, platform: Platform) -> None:
        self._platform = platform
        self._held: dict[str, tuple[Array, Array]] = {}
        self._wheel_limits = np.array([wheel.speed_limit for wheel in platform.wheels])
        self._travel = np.array([stage.travel for stage in platform.stages]).reshape(-1, 2)
        self._moment = np.array([stage.mass * stage.axis for stage in platform.stages])

    def styles(self) -> Iterator[tuple[str, rr.SeriesLines]]:
        """Names and colours of every series that can come, by entity path."""
        platform = self._platform
        if platform.base.kind == "hinge":
            name = platform.base.joint
            for path in (JOINT_ANGLE, JOINT_RATE, JOINT_TORQUE):
                yield path, _lines([name])
            return
        limits = [] if np.isinf(platform.tilt_limit) else ["stop"]
        yield TILT, _lines(["tilt"], limits)
        yield ATTITUDE, _lines(["yaw", "pitch", "roll"])
        yield ATTITUDE_ERROR, _lines(["about x", "about y", "about z"])
        yield RATE, _lines(["x", "y", "z"])
        yield GRAVITY_TORQUE, _lines(["|m r x g|"])
        wheels = [wheel.name for wheel in platform.wheels]
        yield WHEEL_SPEED, _lines(wheels, ["limit", "limit"])
        yield STAGE_POSITION, _lines([stage.name for stage in platform.stages], ["end", "end"])

    def derived(self, rows: Rows) -> dict[str, tuple[Array, Array]]:
        """Times and values by entity path."""
        present = {name: row for name, row in rows.items() if len(row[0])}
        plots = dict(self._of_hinge(present) if self._is_hinge else self._of_ball(present))
        self._held |= {name: (time[-1:], value[-1:]) for name, (time, value) in present.items()}
        return plots

    @property
    def _is_hinge(self) -> bool:
        return self._platform.base.kind == "hinge"

    def _of_hinge(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        for path, streams, factor in (
            (JOINT_ANGLE, ("joint_angle", "truth_joint_angle"), np.degrees(1.0)),
            (JOINT_RATE, ("joint_rate", "truth_joint_rate"), np.degrees(1.0)),
            (JOINT_TORQUE, ("command_joint_torque",), 1.0),
        ):
            if (found := _first_of(rows, *streams)) is not None:
                yield path, (found[0], factor * found[1])

    def _of_ball(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        attitude = _first_of(rows, "estimate_attitude", "attitude", "truth_attitude")
        if attitude is not None:
            time, quat = attitude
            tilt = np.degrees(rotation.tilt(quat))[:, None]
            yield TILT, (time, _with_lines(tilt, self._tilt_lines()))
            yield ATTITUDE, (time, np.degrees(rotation.to_euler_zyx(quat)))
            reference = self._at(time, "reference_attitude", rows)
            if reference is not None:
                error = rotation.multiply(rotation.conjugate(reference), quat)
                yield ATTITUDE_ERROR, (time, np.degrees(rotation.to_rotation_vector(error)))
        rate = _first_of(rows, "estimate_rate", "gyro", "truth_rate")
        if rate is not None:
            yield RATE, (rate[0], np.degrees(rate[1]))
        wheels = _first_of(rows, "wheel_speed", "truth_wheel_speed")
        if wheels is not None and self._wheel_limits.size:
            limit = float(self._wheel_limits.min())
            yield WHEEL_SPEED, (wheels[0], _with_lines(wheels[1], [limit, -limit]))
        stages = _first_of(rows, "stage_position", "truth_stage_position")
        if stages is not None and self._travel.size:
            ends = [1e3 * self._travel[:, 1].max(), 1e3 * self._travel[:, 0].min()]
            yield STAGE_POSITION, (stages[0], _with_lines(1e3 * stages[1], ends))
        yield from self._gravity_torque(rows)

    def _gravity_torque(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        """|(m r) x g| [mN m], true in a simulation, else by the platform's own m r."""
        attitude = _first_of(rows, "truth_attitude", "estimate_attitude", "attitude")
        if attitude is None:
            return
        time, quat = attitude
        moment = self._at(time, "truth_center_of_mass_offset", rows)
        if moment is None:
            moment = np.tile(self._platform.center_of_mass_offset, (len(time), 1))
            stages = self._at(time, "stage_position", rows)
            if stages is not None and self._moment.size:
                moment = moment + stages @ self._moment
        up = rotation.vertical_body(quat)
        torque = self._platform.gravity * np.linalg.norm(rotation.cross(moment, up), axis=1)
        yield GRAVITY_TORQUE, (time, 1e3 * torque[:, None])

    def _at(self, times: Array, stream: str, rows: Rows) -> Array | None:
        """The stream's last value at each time; its first before it began; None if never seen."""
        held, fresh = self._held.get(stream), rows.get(stream)
        pieces = [piece for piece in (held, fresh) if piece is not None]
        if not pieces:
            return None
        time, value = (np.concatenate(part) for part in zip(*pieces, strict=True))
        index = np.searchsorted(time, times, side="right") - 1
        return value[np.maximum(index, 0)]

    def _tilt_lines(self) -> list[float]:
        limit = self._platform.tilt_limit
        return [] if np.isinf(limit) else [float(np.degrees(limit))]


def _first_of(rows: Rows, *streams: str) -> tuple[Array, Array] | None:
    return next((rows[stream] for stream in streams if stream in rows), None)


def _with_lines(value: Array, levels: list[float]) -> Array:
    """Value with a column for each constant line."""
    return np.column_stack([value, *(np.full(len(value), level) for level in levels)])


def _lines(names: list[str], limits: list[str] | None = None) -> rr.SeriesLines:
    colors = [PALETTE[i % len(PALETTE)] for i in range(len(names))]
    extra = limits or []
    return rr.SeriesLines(
        names=[*names, *extra],
        colors=[*colors, *([_LIMIT] * len(extra))],
        widths=[1.5] * len(names) + [1.0] * len(extra),
    )
