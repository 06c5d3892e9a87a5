"""The vectors of a machine's dynamics, drawn on its body: momentum, torque, field, dipoles, thrust.

All are in body axes on entities below the base's body, so that the viewer turns and carries them
with it. An arrow points exactly; its length l = L v / (v + v_half) grows with the size v, is half
of its longest where v is `v_half`, and never leaves the view.
"""

from collections.abc import Iterator, Mapping

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from twin import rotation
from twin.platform import Platform
from twin.platform.parts import Rotor
from twin.recording.rrd import timeline

Array = NDArray[np.float64]
Rows = Mapping[str, tuple[Array, Array]]

ATTITUDES = ("estimate_attitude", "attitude", "truth_attitude")
ANGLES = ("joint_angle", "truth_joint_angle")
RATES = ("estimate_rate", "gyro", "truth_rate")
JOINT_RATES = ("joint_rate", "truth_joint_rate")
WHEEL_SPEEDS = ("wheel_speed", "truth_wheel_speed")
GIMBAL_ANGLES = ("gimbal_angle", "truth_gimbal_angle")
STAGE_POSITIONS = ("stage_position", "truth_stage_position", "command_stage_position")
"""Streams of one quantity, the best first."""

MOMENTUM, WHEELS, GRAVITY = "momentum", "wheel_momentum", "gravity_torque"
FIELD, DIPOLE, THRUST = "magnetic_field", "dipole", "thrust"
CENTER_OF_MASS, CENTER_OF_ROTATION = "center_of_mass", "center_of_rotation"
"""Last parts of entity paths."""

PERIOD = 0.05
"""Shortest time between two drawn states [s]."""

_LONGEST = 0.5
"""Of an arrow, in parts of the model's extent."""
_THICK = 0.006
"""Radius of an arrow, in parts of the model's extent."""
_BALANCED = 2e-5
"""Offset of the CM whose gravity torque at 90 deg is drawn half as long as can be [m]."""
_FIELD = 3e-5
"""Of the Earth [T]."""
_TURNING = 0.05
"""Body rate whose momentum is drawn half as long as can be, of a machine without wheels [rad/s]."""
_LARGEST = 1000.0
"""Times that the offset of the CM is drawn larger."""

_COLORS = {
    MOMENTUM: (240, 170, 40),
    WHEELS: (250, 215, 140),
    GRAVITY: (225, 70, 65),
    FIELD: (80, 150, 240),
    DIPOLE: (170, 110, 220),
    THRUST: (120, 220, 230),
}


class Latest:
    """The last value of each stream at any time, over rows that come block by block."""

    def __init__(self) -> None:
        self._held: dict[str, tuple[Array, Array]] = {}

    def hold(self, rows: Rows) -> None:
        """Keep the last row of each stream for the blocks to come."""
        for name, (time, value) in rows.items():
            if len(time):
                self._held[name] = time[-1:], value[-1:]

    def at(self, times: Array, rows: Rows, *streams: str) -> Array | None:
        """(m, k) of the first of these streams that has come; before its first row, that row."""
        for stream in streams:
            pieces = [
                piece
                for piece in (self._held.get(stream), rows.get(stream))
                if piece is not None and len(piece[0])
            ]
            if pieces:
                time, value = (np.concatenate(part) for part in zip(*pieces, strict=True))
                index = np.searchsorted(time, times, side="right") - 1
                return value[np.maximum(index, 0)]
        return None


class Vectors:
    """Arrows and markers of one platform."""

    def __init__(self, platform: Platform, model: mujoco.MjModel, path: str) -> None:
        """Nothing is drawn yet.

        Args:
            platform: the machine.
            model: of its MJCF.
            path: entity of the base's body.
        """
        self._platform, self._path = platform, path
        self._latest = Latest()
        self._drawn = -np.inf
        self._known, self._fresh = set[str](), set[str]()
        """Entities that have been drawn; and those of them that `appeared` has not given yet."""
        joint = model.joint(platform.base.joint).id
        body = int(model.jnt_bodyid[joint])
        free = platform.base.kind == "free"
        self._origin = np.zeros(3) if free else model.jnt_pos[joint].copy()
        self._hinge = model.jnt_axis[joint].copy() if platform.base.kind == "hinge" else None
        data = mujoco.MjData(model)
        mujoco.mj_kinematics(model, data)
        self._rest = data.xquat[body].copy()
        turners = (*platform.wheels, *platform.rotors)
        ids = [int(model.jnt_bodyid[model.joint(part.name).id]) for part in turners]
        self._hubs = rotation.rotate(
            rotation.conjugate(self._rest), data.xpos[ids] - data.xpos[body]
        ).reshape(-1, 3)
        self._extent = float(model.stat.extent)
        self._scale = self._sizes()
        self._larger = self._magnification()

    @property
    def _has_field(self) -> bool:
        stated = bool(self._platform.magnetic_field.any()) and bool(self._platform.magnetorquers)
        return stated or "magnetometer" in self._platform.sensors

    def appeared(self) -> list[tuple[str, rr.AsComponents]]:
        """Names, colours and origins of what `chunks` has drawn for the first time."""
        fresh = [(path, style) for path, style in self._styles() if path in self._fresh]
        self._known |= self._fresh
        self._fresh = set()
        return fresh

    def _styles(self) -> Iterator[tuple[str, rr.AsComponents]]:
        times = "" if self._larger == 1.0 else f", offset drawn × {self._larger:g}"
        names = {MOMENTUM: "angular momentum", GRAVITY: "gravity torque"}
        names |= {FIELD: "magnetic field", DIPOLE: "dipole"}
        for kind, name in names.items():
            yield self._at(kind), self._arrows(kind, [name], self._origin[None])
        if len(self._hubs):
            parts = (*self._platform.wheels, *self._platform.rotors)
            labels = [f"momentum of {part.name}" for part in parts]
            yield self._at(WHEELS), self._arrows(WHEELS, labels, self._hubs, named=False)
        if self._platform.thrusters:
            labels = [thruster.name for thruster in self._platform.thrusters]
            points = np.array([thruster.point for thruster in self._platform.thrusters])
            yield self._at(THRUST), self._arrows(THRUST, labels, self._origin + points, named=False)
        yield (
            self._at(CENTER_OF_MASS),
            rr.Points3D.from_fields(
                radii=[2.5 * _THICK * self._extent],
                colors=[(250, 220, 60)],
                labels=[f"centre of mass{times}"],
                show_labels=True,
            ),
        )
        yield (
            self._at(CENTER_OF_ROTATION),
            rr.Points3D.from_fields(radii=[1.5 * _THICK * self._extent], colors=[(255, 255, 255)]),
        )

    def chunks(self, rows: Rows) -> list[Chunk]:
        """The arrows at the times at which the attitude, or joint angle, is known anew."""
        present = {name: row for name, row in rows.items() if len(row[0])}
        streams = ATTITUDES if self._hinge is None else ANGLES
        lead = next((name for name in streams if name in present), None)
        drawn: list[Chunk] = []
        if lead is not None:
            times = self._thinned(present[lead][0])
            start = min(time[0] for time, _ in present.values())
            if not self._known and start < times[0]:
                times = np.append(start, times)
            if times.size:
                drawn = list(self._drawn_at(times, present))
            self._fresh |= {chunk.entity_path.removeprefix("/") for chunk in drawn} - self._known
        self._latest.hold(present)
        return drawn

    def _drawn_at(self, times: Array, rows: Rows) -> Iterator[Chunk]:
        body_from_world = rotation.conjugate(self._attitude(times, rows))
        moment = self._moment(times, rows)
        if self._hinge is None and self._at(CENTER_OF_ROTATION) not in self._known:
            yield Chunk.from_columns(
                self._at(CENTER_OF_ROTATION),
                indexes=[timeline(times[:1])],
                columns=rr.Points3D.columns(positions=self._origin[None]),
            )
        place = self._larger * moment / self._platform.mass
        size = np.linalg.norm(place, axis=1, keepdims=True)
        place = place * np.minimum(1.0, _LONGEST * self._extent / np.maximum(size, 1e-12))
        yield Chunk.from_columns(
            self._at(CENTER_OF_MASS),
            indexes=[timeline(times)],
            columns=rr.Points3D.columns(positions=self._origin + place),
        )
        down = np.array([0.0, 0.0, -self._platform.gravity])
        pull = rotation.rotate(body_from_world, down)
        yield self._chunk(GRAVITY, times, rotation.cross(moment, pull)[:, None])
        wheels = self._wheel_momenta(times, rows)
        if wheels.shape[1]:
            yield self._chunk(WHEELS, times, wheels, MOMENTUM)
        rate = self._rate(times, rows)
        if rate is not None:
            whole = rate @ self._platform.inertia + wheels.sum(axis=1)
            yield self._chunk(MOMENTUM, times, whole[:, None])
        field = self._field(times, rows, body_from_world)
        if field is not None:
            yield self._chunk(FIELD, times, field[:, None])
        dipole = self._latest.at(times, rows, "command_dipole")
        if dipole is not None and dipole.shape[1] == 3:
            yield self._chunk(DIPOLE, times, dipole[:, None])
        force = self._latest.at(times, rows, "command_thruster")
        if force is not None and self._platform.thrusters:
            limit = np.array([thruster.force_limit for thruster in self._platform.thrusters])
            out = np.array([-thruster.direction for thruster in self._platform.thrusters])
            yield self._chunk(THRUST, times, (force / limit)[:, :, None] * out)

    def _attitude(self, times: Array, rows: Rows) -> Array:
        """(m, 4) world from body."""
        if self._hinge is None:
            attitude = self._latest.at(times, rows, *ATTITUDES)
            assert attitude is not None
            return attitude
        angle = self._latest.at(times, rows, *ANGLES)
        assert angle is not None
        turn = rotation.from_rotation_vector(angle[:, :1] * self._hinge)
        return rotation.multiply(self._rest, turn)

    def _rate(self, times: Array, rows: Rows) -> Array | None:
        """(m, 3) body axes [rad/s]."""
        if self._hinge is None:
            return self._latest.at(times, rows, *RATES)
        rate = self._latest.at(times, rows, *JOINT_RATES)
        return None if rate is None else rate[:, :1] * self._hinge

    def _moment(self, times: Array, rows: Rows) -> Array:
        """(m, 3) m r [kg m]: true in a simulation, else as the platform states it."""
        moment = self._latest.at(times, rows, "truth_center_of_mass_offset")
        if moment is not None:
            return moment
        moment = np.tile(self._platform.center_of_mass_offset, (len(times), 1))
        stages = self._latest.at(times, rows, *STAGE_POSITIONS)
        if stages is not None and self._platform.stages:
            moment = moment + stages @ np.array([s.mass * s.axis for s in self._platform.stages])
        return moment

    def _wheel_momenta(self, times: Array, rows: Rows) -> Array:
        """(m, wheels and rotors, 3) relative to the body [N m s]."""
        platform = self._platform
        parts = (*platform.wheels, *platform.rotors)
        speed = self._latest.at(times, rows, *WHEEL_SPEEDS)
        if speed is None or speed.shape[1] != len(platform.wheels):
            speed = np.tile([wheel.home for wheel in platform.wheels], (len(times), 1))
        angles = self._latest.at(times, rows, *GIMBAL_ANGLES)
        momenta = np.zeros((len(times), len(parts), 3))
        for number, part in enumerate(parts):
            axis = np.tile(part.axis, (len(times), 1))
            for k, gimbal in enumerate(platform.gimbals):
                if gimbal.name == part.gimbal:
                    home = np.full(len(times), gimbal.home)
                    delta = (home if angles is None else angles[:, k])[:, None]
                    across = np.cross(gimbal.axis, part.axis)
                    axis = part.axis * np.cos(delta) + across * np.sin(delta)
            size = part.momentum if isinstance(part, Rotor) else part.inertia * speed[:, number]
            momenta[:, number] = axis * np.reshape(size, (-1, 1))
        return momenta

    def _field(self, times: Array, rows: Rows, body_from_world: Array) -> Array | None:
        """(m, 3) body axes [T]: measured, else as the log or the platform states it."""
        measured = self._latest.at(times, rows, "magnetometer")
        if measured is not None:
            return measured
        room = self._latest.at(times, rows, "magnetic_field")
        if room is None and not self._has_field:
            return None
        field = self._platform.magnetic_field if room is None else room
        return rotation.rotate(body_from_world, field)

    def _sizes(self) -> dict[str, float]:
        """SI size of each kind that is drawn half as long as can be."""
        platform = self._platform
        limits = [wheel.momentum_limit for wheel in platform.wheels]
        limits += [abs(rotor.momentum) for rotor in platform.rotors]
        limits = [limit for limit in limits if np.isfinite(limit) and limit > 0.0]
        turning = _TURNING * float(np.max(np.diag(platform.inertia)))
        coils = [coil.dipole_limit for coil in platform.magnetorquers]
        return {
            MOMENTUM: 0.1 * min(limits) if limits else turning,
            GRAVITY: platform.mass * max(platform.gravity, 1e-3) * _BALANCED,
            FIELD: _FIELD,
            DIPOLE: 0.5 * max(coils) if coils else 1.0,
            THRUST: 1.0,
        }

    def _magnification(self) -> float:
        """The power of ten by which the offset of the CM is drawn larger."""
        platform = self._platform
        reach = float(np.linalg.norm(platform.center_of_mass_offset))
        reach = max(reach, *(s.mass * max(map(abs, s.travel)) for s in platform.stages), 1e-12)
        room = 0.5 * _LONGEST * self._extent / (reach / platform.mass)
        return float(np.clip(10.0 ** np.floor(np.log10(room)), 1.0, _LARGEST))

    def _thinned(self, time: Array) -> Array:
        """Times at least `PERIOD` apart."""
        kept: list[float] = []
        for now in time.tolist():
            if now - self._drawn >= PERIOD - 1e-6:
                kept.append(now)
                self._drawn = now
        return np.array(kept)

    def _at(self, kind: str) -> str:
        return f"{self._path}/{kind}".removeprefix("/")

    def _arrows(
        self, kind: str, names: list[str], origins: Array, *, named: bool = True
    ) -> rr.Arrows3D:
        return rr.Arrows3D.from_fields(
            origins=origins,
            labels=names,
            show_labels=named,
            colors=[_COLORS[kind]] * len(names),
            radii=[_THICK * self._extent] * len(names),
        )

    def _chunk(self, kind: str, times: Array, values: Array, scale: str = "") -> Chunk:
        """Arrows of values (m, count, 3), in their own unit."""
        size = np.linalg.norm(values, axis=2, keepdims=True)
        vectors = _LONGEST * self._extent * values / (size + self._scale[scale or kind])
        columns = rr.Arrows3D.columns(vectors=vectors.reshape(-1, 3))
        return Chunk.from_columns(
            self._at(kind),
            indexes=[timeline(times)],
            columns=columns.partition([values.shape[1]] * len(times)),
        )
