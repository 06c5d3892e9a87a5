"""What a person sees on opening a recording: the machine in 3D beside its plots.

The machine in 3D: the MJCF's own visible geoms on entities that follow its body tree.
The bus turns with the attitude (or the hinge angle), the stages slide, gimbals and wheels turn, and
what floats away goes where the CR goes. A translucent ghost of the base is at the predicted motion,
or else at the target. `twin.stream.vectors` adds arrows and the centre of mass.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from rerun.chunk import Chunk

from twin import rotation
from twin.platform import Platform
from twin.platform.mjcf import load_mjcf
from twin.recording.rrd import PALETTE, entity, timeline, tree_of
from twin.recording.rrd_reader import TIMELINE
from twin.signals import PREDICTED, RESIDUAL, TOWARDS
from twin.stream.rows import Header, Placed
from twin.stream.vectors import (
    ANGLES,
    ATTITUDES,
    GIMBAL_ANGLES,
    JOINT_RATES,
    RATES,
    STAGE_POSITIONS,
    WHEEL_SPEEDS,
    Latest,
    Vectors,
)

Array = NDArray[np.float64]


Rows = Mapping[str, tuple[Array, Array]]

SAID = "plots/said"
TILT = "plots/tilt"
ATTITUDE = "plots/attitude"
ATTITUDE_ERROR = "plots/attitude_error"
RATE = "plots/rate"
WHEEL_SPEED = "plots/wheel_speed"
STAGE_POSITION = "plots/stage_position"
PLACE = "plots/place"
PLACE_ERROR = "plots/place_error"
GRAVITY_TORQUE = "plots/gravity_torque"
JOINT_ANGLE = "plots/joint_angle"
JOINT_RATE = "plots/joint_rate"
JOINT_TORQUE = "plots/joint_torque"

_LIMIT = (150, 150, 150)
_NEAR = 0.5
"""Share of a limit from which on its line is drawn: farther away it would flatten the curves."""
_RPM = 30.0 / np.pi
"""[rpm] per rad/s."""


RELATIVE_ATTITUDE = f"plots/relative_attitude{TOWARDS}"
RELATIVE_PLACE = f"plots/relative_place{TOWARDS}"
"""Before the name of the other machine."""


class Plots:
    """Derived series of one platform; a stream's last value is held for the rows to come."""

    def __init__(self, platform: Platform, others: Sequence[str] = ()) -> None:
        """Of a machine, in a run with others of these names."""
        self._platform, self._others = platform, others
        self._latest = Latest()
        self._wheel_limits = _RPM * np.array([wheel.speed_limit for wheel in platform.wheels])
        self._travel = 1e3 * np.array([stage.travel for stage in platform.stages]).reshape(-1, 2)
        self._moment = np.array([stage.mass * stage.axis for stage in platform.stages])

    @property
    def _place_axes(self) -> int:
        """Along which the machine travels: of a planar stage x and y."""
        return 2 if self._platform.base.planar else 3

    def styles(self) -> Iterator[tuple[str, rr.SeriesLines]]:
        """Names and colours of every series that can come, by entity path."""
        platform = self._platform
        for other in self._others:
            yield RELATIVE_ATTITUDE + entity(other), _lines(["about x", "about y", "about z"])
            yield RELATIVE_PLACE + entity(other), _lines(["x", "y", "z"])
        if platform.base.kind == "hinge":
            name = platform.base.joint
            for path in (JOINT_ANGLE, JOINT_RATE, JOINT_TORQUE):
                yield path, _lines([name])
            return
        yield TILT, _lines(["tilt"])
        yield ATTITUDE, _lines(["yaw", "pitch", "roll"])
        yield ATTITUDE_ERROR, _lines(["about x", "about y", "about z"])
        yield RATE, _lines(["x", "y", "z"])
        yield GRAVITY_TORQUE, _lines(["|m r x g|"])
        wheels = [wheel.name for wheel in platform.wheels]
        yield WHEEL_SPEED, _lines(wheels)
        yield STAGE_POSITION, _lines([stage.name for stage in platform.stages])
        axes = ["x", "y", "z"][: self._place_axes]
        yield PLACE, _lines(axes)
        yield PLACE_ERROR, _lines(axes)
        for path, ends in (
            (TILT, ["stop"]),
            (WHEEL_SPEED, ["limit"] * 2),
            (STAGE_POSITION, ["end"] * 2),
        ):
            yield (
                f"{path}/limit",
                rr.SeriesLines(names=ends, colors=[_LIMIT] * len(ends), widths=[1.0] * len(ends)),
            )

    def derived(self, rows: Rows) -> dict[str, tuple[Array, Array]]:
        """Times and values by entity path."""
        present = {name: row for name, row in rows.items() if len(row[0])}
        plots = dict(self._of_hinge(present) if self._is_hinge else self._of_ball(present))
        plots |= dict(self._of_others(present))
        self._latest.hold(present)
        return plots

    def _of_others(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        """Relative to other machines, true in a simulation."""
        for other in self._others:
            name = f"relative_attitude{TOWARDS}{other}"
            if (turn := _first_of(rows, f"truth_{name}", name)) is not None:
                vector = np.degrees(rotation.to_rotation_vector(turn[1]))
                yield RELATIVE_ATTITUDE + entity(other), (turn[0], vector)
            name = f"relative_position{TOWARDS}{other}"
            if (place := _first_of(rows, f"truth_{name}", name)) is not None:
                yield RELATIVE_PLACE + entity(other), place

    @property
    def _is_hinge(self) -> bool:
        return self._platform.base.kind == "hinge"

    def _of_hinge(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        for path, streams, factor in (
            (JOINT_ANGLE, ANGLES, np.degrees(1.0)),
            (JOINT_RATE, JOINT_RATES, np.degrees(1.0)),
            (JOINT_TORQUE, ("command_joint_torque",), 1.0),
        ):
            if (result := _first_of(rows, *streams)) is not None:
                yield path, (result[0], factor * result[1])

    def _of_ball(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        attitude = _first_of(rows, *ATTITUDES)
        if attitude is not None:
            time, quat = attitude
            tilt = np.degrees(rotation.tilt(quat))[:, None]
            yield TILT, (time, tilt)
            if np.isfinite(self._platform.tilt_limit):
                stop = float(np.degrees(self._platform.tilt_limit))
                yield from _limits(TILT, time, tilt, [stop])
            yield ATTITUDE, (time, np.degrees(rotation.to_euler_zyx(quat)))
            reference = self._latest.at(time, rows, "reference_attitude")
            if reference is not None:
                error = rotation.multiply(rotation.conjugate(reference), quat)
                yield ATTITUDE_ERROR, (time, np.degrees(rotation.to_rotation_vector(error)))
        rate = _first_of(rows, *RATES)
        if rate is not None:
            yield RATE, (rate[0], np.degrees(rate[1]))
        wheels = _first_of(rows, *WHEEL_SPEEDS)
        if wheels is not None and self._wheel_limits.size:
            time, speed = wheels[0], _RPM * wheels[1]
            limit = float(self._wheel_limits.min())
            yield WHEEL_SPEED, (time, speed)
            yield from _limits(WHEEL_SPEED, time, speed, [limit, -limit])
        stages = _first_of(rows, "stage_position", "truth_stage_position")
        if stages is not None and self._travel.size:
            time, place = stages[0], 1e3 * stages[1]
            yield STAGE_POSITION, (time, place)
            ends = [self._travel[:, 1].max(), self._travel[:, 0].min()]
            yield from _limits(STAGE_POSITION, time, place, ends)
        where = _first_of(rows, "estimate_position", "position", "truth_position")
        if where is not None and self._platform.base.travels:
            time, place = where[0], where[1][:, : self._place_axes]
            yield PLACE, (time, place)
            asked = self._latest.at(time, rows, "reference_position")
            if asked is not None:
                yield PLACE_ERROR, (time, 1e3 * (place - asked[:, : self._place_axes]))
        yield from self._gravity_torque(rows)

    def _gravity_torque(self, rows: Rows) -> Iterator[tuple[str, tuple[Array, Array]]]:
        """|(m r) x g| [mN m], true in a simulation, else by the platform's own m r."""
        attitude = _first_of(rows, "truth_attitude", "estimate_attitude", "attitude")
        if attitude is None:
            return
        time, quat = attitude
        moment = self._latest.at(time, rows, "truth_center_of_mass_offset")
        if moment is None:
            moment = np.tile(self._platform.center_of_mass_offset, (len(time), 1))
            stages = self._latest.at(time, rows, "stage_position")
            if stages is not None and self._moment.size:
                moment = moment + stages @ self._moment
        up = rotation.vertical_body(quat)
        torque = self._platform.gravity * np.linalg.norm(rotation.cross(moment, up), axis=1)
        yield GRAVITY_TORQUE, (time, 1e3 * torque[:, None])


def _first_of(rows: Rows, *streams: str) -> tuple[Array, Array] | None:
    return next((rows[stream] for stream in streams if stream in rows), None)


def _limits(
    path: str, time: Array, value: Array, levels: Sequence[float]
) -> Iterator[tuple[str, tuple[Array, Array]]]:
    """Lines at `levels` over the times at which a value (m, k) is near one of them."""
    near = np.abs(value).max(axis=1) >= _NEAR * min(map(abs, levels))
    if near.any():
        yield f"{path}/limit", (time[near], np.tile(levels, (int(near.sum()), 1)))


def _lines(names: list[str]) -> rr.SeriesLines:
    colors = [PALETTE[i % len(PALETTE)] for i in range(len(names))]
    return rr.SeriesLines(names=names, colors=colors, widths=[1.5] * len(names))


WORLD = "world"

_HEADINGS = ("truth_heading",)
_PLACES = ("position", "truth_position")
"""Streams that move the machine; the first that is there does."""
_GHOSTS = ("predicted_attitude", "predicted_joint_angle", "reference_attitude")
"""Streams that a ghost of the base follows; the first that is there."""
_GHOST = (120, 200, 255, 70)
"""Its colour; most of what is behind shows through."""
_SLOW = np.pi
"""A wheel at its limit is drawn turning at this speed [rad/s], others in proportion: at their true
speeds they would be a blur, or seem to turn backwards."""

_HIDDEN_GROUP = 3
"""MuJoCo's viewer shows geoms of the groups below this one."""

_BOUNDLESS = 2.0
"""Half the side of a plane that has no end [m]."""

_FLAT = 1e-3
"""Half the thickness that a plane is drawn with [m]."""


class Scene:
    """One platform, drawn."""

    def __init__(self, platform: Platform, root: str = WORLD) -> None:
        """Of a machine whose room is the entity `root`."""
        self._platform = platform
        self._model = load_mjcf(platform.model_path)
        self._paths = _body_paths(self._model, root)
        base = platform.base
        self._base = base
        self._parts = (
            ((base.joint,), ANGLES if base.kind == "hinge" else ATTITUDES),
            (tuple(stage.name for stage in platform.stages), STAGE_POSITIONS),
            (tuple(gimbal.name for gimbal in platform.gimbals), GIMBAL_ANGLES),
            (base.planar[2:], _HEADINGS),
        )
        """Joints, and the streams that move them, the best first."""
        self._wheels = [wheel.name for wheel in platform.wheels]
        self._slow = np.array([_SLOW / wheel.speed_limit for wheel in platform.wheels])
        self._turned_by: tuple[float, Array, Array] | None = None
        """Time, drawn angle and drawn speed of the wheels at their last row."""
        self._joints = [*(joint for joints, _ in self._parts for joint in joints), *self._wheels]
        self._carried = base.joint if base.kind == "free" else (*base.planar, "")[0]
        """The joint whose body goes where the CR goes; empty where the CR stands."""
        self._chosen: dict[tuple[str, ...], str] = {}
        self._placed = False
        self._body = int(self._model.jnt_bodyid[self._model.joint(base.joint).id])
        above = self._paths[int(self._model.body_parentid[self._body])]
        self._ghost = f"{above}/ghost"
        self._ghost_stream = ""
        self._fresh: list[tuple[str, rr.AsComponents]] = []
        self._vectors = Vectors(platform, self._model, self._paths[self._body])

    def shapes(self) -> Iterator[tuple[str, rr.AsComponents]]:
        """What does not change: entity path and archetype."""
        model = self._model
        if self._paths[0] == WORLD:
            yield WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP
        joints = [*self._joints, *filter(None, [self._carried])]
        moving = {int(model.jnt_bodyid[model.joint(name).id]) for name in joints}
        for body in range(1, model.nbody):
            if body not in moving:
                yield (
                    self._paths[body],
                    rr.Transform3D(
                        translation=model.body_pos[body],
                        quaternion=rr.Quaternion(xyzw=_xyzw(model.body_quat[body])),
                    ),
                )
        for body in range(model.nbody):
            yield from self._geoms(body, self._paths[body])

    def appeared(self) -> list[tuple[str, rr.AsComponents]]:
        """What does not change of things that `motion` has begun to draw since the last call."""
        fresh, self._fresh = self._fresh, []
        return fresh

    def _ghost_shapes(self) -> Iterator[tuple[str, rr.AsComponents]]:
        model, first = self._model, self._paths[self._body]
        for body in range(1, model.nbody):
            if not f"{self._paths[body]}/".startswith(f"{first}/"):
                continue
            path = self._ghost + self._paths[body].removeprefix(first)
            if body != self._body:
                place = model.body_pos[body], _xyzw(model.body_quat[body])
                yield (
                    path,
                    rr.Transform3D(translation=place[0], quaternion=rr.Quaternion(xyzw=place[1])),
                )
            yield from self._geoms(body, path, _GHOST)

    def _geoms(
        self, body: int, path: str, color: tuple[int, ...] | None = None
    ) -> Iterator[tuple[str, rr.AsComponents]]:
        """What MuJoCo's viewer shows of a body, in its own colours or in one."""
        model = self._model
        ids = np.arange(model.ngeom)[model.geom_bodyid == body]
        shown = [int(i) for i in ids if model.geom_group[i] < _HIDDEN_GROUP]
        for kind in sorted({int(model.geom_type[i]) for i in shown}):
            same = [i for i in shown if model.geom_type[i] == kind]
            colors = (
                _colors(model, same)
                if color is None
                else np.tile(np.array(color, dtype=np.uint8), (len(same), 1))
            )
            yield from _shapes(model, path, mujoco.mjtGeom(kind), same, colors)

    def motion(self, rows: Mapping[str, tuple[Array, Array]]) -> list[Chunk]:
        """Where the moving bodies are, at the times of the rows."""
        chunks: list[Chunk] = []
        starts = [time[0] for time, _ in rows.values() if len(time)]
        known = (name for name in _GHOSTS if name in rows and len(rows[name][0]))
        ghost = next(known, "")
        hinge = self._base.kind == "hinge"
        begins = not self._ghost_stream and ghost and hinge == ghost.endswith("joint_angle")
        if begins:
            self._ghost_stream = ghost
            self._fresh += self._ghost_shapes()
            first = np.array([min(starts)])
            chunks.append(self._ghost_moved(first, rows[ghost][1][:1]))
        if not self._placed and starts:
            # A body whose stream is never recorded stays where the MJCF has it.
            self._placed = True
            start = np.array([min(starts)])
            for name in self._joints:
                rest = self._model.qpos0[self._model.joint(name).qposadr[0]]
                chunks.append(self._moved(name, start, np.array([rest])))
            if self._carried:
                chunks += self._carried_to(start, self._anchor()[None])
        for joints, streams in self._parts:
            stream = self._stream(streams, rows)
            if stream is None:
                continue
            time, value = rows[stream]
            if stream in ATTITUDES:
                chunks.append(self._turned(joints[0], time, value))
            else:
                chunks += [self._moved(n, time, value[:, i]) for i, n in enumerate(joints)]
        place = self._stream(_PLACES, rows) if self._carried else None
        if place is not None:
            chunks += self._carried_to(*rows[place])
        wheels = self._stream(WHEEL_SPEEDS, rows) if self._wheels else None
        if wheels is not None and rows[wheels][1].shape[1] == len(self._wheels):
            time, angle = self._spun(*rows[wheels])
            chunks += [self._moved(n, time, angle[:, i]) for i, n in enumerate(self._wheels)]
        if self._ghost_stream in rows and len(rows[self._ghost_stream][0]):
            chunks.append(self._ghost_moved(*rows[self._ghost_stream]))
        chunks += self._vectors.chunks(rows)
        self._fresh += self._vectors.appeared()
        return chunks

    def _spun(self, time: Array, speed: Array) -> tuple[Array, Array]:
        """Times and angles (m, wheels) that wheels are drawn at: the integral of slowed speeds."""
        slow = speed * self._slow
        before = self._turned_by or (float(time[0]), np.zeros(slow.shape[1]), slow[0])
        steps = np.diff(time, prepend=before[0])[:, None]
        means = 0.5 * (slow + np.vstack([before[2], slow[:-1]]))
        angle = before[1] + np.cumsum(steps * means, axis=0)
        self._turned_by = float(time[-1]), angle[-1], slow[-1]
        return time, angle

    def _ghost_moved(self, time: Array, value: Array) -> Chunk:
        """The ghost as the base would turn; the base's place is its place."""
        turn = value
        if self._base.kind == "hinge":
            number = self._model.joint(self._base.joint).id
            away = value[:, :1] - self._model.qpos0[self._model.jnt_qposadr[number]]
            turn = rotation.from_rotation_vector(away * self._model.jnt_axis[number])
        return self._turned(self._base.joint, time, turn, self._ghost)

    def _stream(
        self, streams: tuple[str, ...], rows: Mapping[str, tuple[Array, Array]]
    ) -> str | None:
        """The stream that was taken first, if it has rows now."""
        stream = self._chosen.get(streams) or next((s for s in streams if s in rows), None)
        if stream is None or stream not in rows or not len(rows[stream][0]):
            return None
        self._chosen[streams] = stream
        return stream

    def _anchor(self) -> Array:
        """(3,) the CR in the room at rest [m]."""
        data = mujoco.MjData(self._model)
        mujoco.mj_kinematics(self._model, data)
        return data.xanchor[self._model.joint(self._base.joint).id].copy()

    def _carried_to(self, time: Array, place: Array) -> list[Chunk]:
        """The body that carries the CR, which is at `place` (m, 3) in the room [m]."""
        body = int(self._model.jnt_bodyid[self._model.joint(self._carried).id])
        translation = self._model.body_pos[body] + place - self._anchor()
        paths = [self._paths[body]]
        if self._base.kind == "free":  # its attitude has a stream and chunks of its own
            columns = rr.Transform3D.columns(translation=translation)
            paths += [self._ghost] if self._ghost_stream else []
        else:
            turn = np.tile(self._model.body_quat[body], (len(time), 1))
            columns = rr.Transform3D.columns(translation=translation, quaternion=_xyzw(turn))
        return [
            Chunk.from_columns(path, indexes=[timeline(time)], columns=columns) for path in paths
        ]

    def _moved(self, joint: str, time: Array, coordinate: Array) -> Chunk:
        """Along a slide or about a hinge; a ball joint at rest."""
        model = self._model
        number = model.joint(joint).id
        away = coordinate - model.qpos0[model.jnt_qposadr[number]]
        axis = model.jnt_axis[number]
        if model.jnt_type[number] == mujoco.mjtJoint.mjJNT_SLIDE:
            body = model.jnt_bodyid[number]
            turn = model.body_quat[body]
            shift = rotation.rotate(turn, away[:, None] * axis)
            return self._chunk(
                number, time, model.body_pos[body] + shift, np.tile(turn, (len(time), 1))
            )
        if model.jnt_type[number] in (mujoco.mjtJoint.mjJNT_BALL, mujoco.mjtJoint.mjJNT_FREE):
            return self._turned(joint, time, np.tile(rotation.IDENTITY, (len(time), 1)))
        return self._turned(joint, time, rotation.from_rotation_vector(away[:, None] * axis))

    def _turned(self, joint: str, time: Array, turn: Array, path: str = "") -> Chunk:
        """About the joint's anchor, which stays where it is."""
        model = self._model
        number = model.joint(joint).id
        body, anchor = model.jnt_bodyid[number], model.jnt_pos[number]
        quat = rotation.multiply(model.body_quat[body], turn)
        fixed = model.body_pos[body] + rotation.rotate(model.body_quat[body], anchor)
        return self._chunk(number, time, fixed - rotation.rotate(quat, anchor), quat, path)

    def _chunk(
        self, joint: int, time: Array, position: Array, quat: Array, path: str = ""
    ) -> Chunk:
        path = path or self._paths[int(self._model.jnt_bodyid[joint])]
        if (
            self._model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE
        ):  # its place has a stream of its own
            columns = rr.Transform3D.columns(quaternion=_xyzw(quat))
        else:
            columns = rr.Transform3D.columns(translation=position, quaternion=_xyzw(quat))
        return Chunk.from_columns(path, indexes=[timeline(time)], columns=columns)


def _body_paths(model: mujoco.MjModel, root: str) -> list[str]:
    """Entity path of every body, by id."""
    paths = [root]
    for body in range(1, model.nbody):
        name = rr.escape_entity_path_part(model.body(body).name or f"body{body}")
        paths.append(f"{paths[int(model.body_parentid[body])]}/{name}")
    return paths


def _shapes(
    model: mujoco.MjModel,
    path: str,
    kind: mujoco.mjtGeom,
    ids: Sequence[int],
    color: NDArray[np.uint8],
) -> Iterator[tuple[str, rr.AsComponents]]:
    """The geoms of one kind on one body, as one archetype; meshes one by one."""
    center, quat, size = model.geom_pos[ids], model.geom_quat[ids], model.geom_size[ids]
    solid = rr.components.FillMode.Solid
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            yield (
                f"{path}/boxes",
                rr.Boxes3D(
                    half_sizes=size,
                    centers=center,
                    quaternions=_xyzw(quat),
                    colors=color,
                    fill_mode=solid,
                ),
            )
        case mujoco.mjtGeom.mjGEOM_PLANE:
            half = np.where(size[:, :2] > 0.0, size[:, :2], _BOUNDLESS)
            slab = np.column_stack([half, np.full(len(half), _FLAT)])
            below = center - rotation.rotate(quat, np.array([0.0, 0.0, _FLAT]))
            yield (
                f"{path}/planes",
                rr.Boxes3D(
                    half_sizes=slab,
                    centers=below,
                    quaternions=_xyzw(quat),
                    colors=color,
                    fill_mode=solid,
                ),
            )
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            yield (
                f"{path}/cylinders",
                rr.Cylinders3D(
                    lengths=2.0 * size[:, 1],
                    radii=size[:, 0],
                    centers=center,
                    quaternions=_xyzw(quat),
                    colors=color,
                    fill_mode=solid,
                ),
            )
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            # MuJoCo's origin is the middle, Rerun's the centre of the lower cap.
            down = np.column_stack([np.zeros((len(ids), 2)), size[:, 1]])
            yield (
                f"{path}/capsules",
                rr.Capsules3D(
                    lengths=2.0 * size[:, 1],
                    radii=size[:, 0],
                    translations=center - rotation.rotate(quat, down),
                    quaternions=_xyzw(quat),
                    colors=color,
                    fill_mode=solid,
                ),
            )
        case mujoco.mjtGeom.mjGEOM_SPHERE | mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            half = size if kind == mujoco.mjtGeom.mjGEOM_ELLIPSOID else size[:, [0, 0, 0]]
            yield (
                f"{path}/{kind.name.removeprefix('mjGEOM_').lower()}s",
                rr.Ellipsoids3D(
                    half_sizes=half,
                    centers=center,
                    quaternions=_xyzw(quat),
                    colors=color,
                    fill_mode=solid,
                ),
            )
        case mujoco.mjtGeom.mjGEOM_MESH:
            for i, own in zip(ids, color, strict=True):
                yield f"{path}/mesh{i}", _mesh(model, i, own)
        case _:
            pass  # height fields and signed distance fields have no counterpart


def _mesh(model: mujoco.MjModel, geom: int, color: NDArray[np.uint8]) -> rr.Mesh3D:
    mesh = model.mesh(int(model.geom_dataid[geom])).id
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(np.float64)
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return rr.Mesh3D(
        vertex_positions=model.geom_pos[geom] + rotation.rotate(model.geom_quat[geom], vertices),
        triangle_indices=model.mesh_face[face : face + faces],
        albedo_factor=color,
    )


def _colors(model: mujoco.MjModel, ids: Sequence[int]) -> NDArray[np.uint8]:
    """A geom's own colour, unless it was left at MuJoCo's grey and has a material."""
    color = model.geom_rgba[ids].astype(np.float64)
    material = model.geom_matid[ids]
    plain = (material >= 0) & (np.abs(color - [0.5, 0.5, 0.5, 1.0]).max(axis=1) < 1e-6)
    color[plain] = model.mat_rgba[material[plain]]
    for row in np.flatnonzero(plain):
        color[row, :3] *= _texture_tint(model, int(material[row]))
    return np.rint(255.0 * color).astype(np.uint8)


def _texture_tint(model: mujoco.MjModel, material: int) -> Array:
    """Mean colour of a material's texture (3,), 1 without one: Rerun's shapes carry none."""
    texture = int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0:
        return np.ones(3)
    channels = int(model.tex_nchannel[texture])
    count = int(model.tex_height[texture]) * int(model.tex_width[texture]) * channels
    first = int(model.tex_adr[texture])
    pixels = model.tex_data[first : first + count].reshape(-1, channels)
    return np.full(3, 1.0) * pixels[:, :3].mean(axis=0) / 255.0


def _xyzw(quat: Array) -> Array:
    """Scalar first to scalar last, which is Rerun's."""
    return quat[..., [1, 2, 3, 0]]


SIGMA = "_sigma"
"""After the name of a stream: its standard deviation."""


def is_sigma(stream: str) -> bool:
    """Whether a stream is the standard deviation of another."""
    return stream.endswith(SIGMA)


PALE = 0.4
"""How much of its colour a predicted curve keeps, beside the measured one."""


def blueprint(
    platform: Platform, *, remarks: bool = False, streams: Mapping[str, Header] | None = None
) -> rrb.Blueprint:
    """The layout for a platform: only plots of what it has.

    Args:
        platform: what is seen.
        remarks: whether there is a place for what is said, below the machine.
        streams: of the recording, where they are known; those that were measured and predicted are
            shown with their residuals in front of the flight's plots, and what an estimator states
            with its sigma behind them.
    """
    flight = _flight(platform, streams or {}, "the flight")
    shown: rrb.Grid | rrb.Tabs = flight
    known = streams or {}
    predicted = [name for name in known if f"{PREDICTED}{name}" in known]
    if predicted:
        pairs = [view for stream in predicted for view in _pair(stream, known)]
        compared = rrb.Grid(*pairs, grid_columns=2, name="measured, predicted, residual")
        shown = rrb.Tabs(compared, flight, active_tab=0)
    return _arranged(_view(platform.title, *_viewpoint(platform)), shown, remarks)


def layout_of_several(machines: Mapping[str, Placed], *, remarks: bool = False) -> rrb.Blueprint:
    """The layout of a run of several machines: one scene, their relative motion, and a tab each."""
    tabs: list[rrb.Grid] = []
    graphs: list[rrb.TimeSeriesView] = []
    eyes: list[tuple[Array, Array]] = []
    for number, (name, placed) in enumerate(machines.items()):
        if placed.platform is None:
            continue
        tabs.append(_flight(placed.platform, placed.streams, name, tree_of(name)))
        center, back = _viewpoint(placed.platform)
        eyes.append((center + placed.origin, back))
        for other in list(machines)[:number]:
            title = f"attitude of {name} relative to {other} [deg]"
            graphs.append(_graph(title, tree_of(name) + RELATIVE_ATTITUDE + entity(other)))
            there = machines[other].platform
            if there is not None and there.base.travels and placed.platform.base.travels:
                title = f"place of {name} relative to {other} [m]"
                graphs.append(_graph(title, tree_of(name) + RELATIVE_PLACE + entity(other)))
    centers = np.array([center for center, _ in eyes])
    spread = float(np.ptp(centers, axis=0).max())
    back = max((back for _, back in eyes), key=lambda away: float(np.linalg.norm(away)))
    scene = _view(", ".join(machines), centers.mean(axis=0), back * (1.0 + spread))
    relative = rrb.Grid(*graphs, grid_columns=1, name="relative")
    return _arranged(scene, rrb.Tabs(relative, *tabs, active_tab=0), remarks)


def _arranged(
    machine: rrb.Spatial3DView, shown: rrb.Grid | rrb.Tabs, remarks: bool
) -> rrb.Blueprint:
    """The scene beside the plots, and below it a place for what is said."""
    scene: rrb.Spatial3DView | rrb.Vertical = machine
    if remarks:
        words = rrb.TextLogColumns(text_log_columns=["body"])
        said = rrb.TextLogView(origin=SAID, name="what was said", columns=words)
        scene = rrb.Vertical(machine, said, row_shares=[3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(scene, shown, column_shares=[2, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


def _flight(
    platform: Platform, streams: Mapping[str, Header], name: str, tree: str = ""
) -> rrb.Grid:
    """Plots of what a platform has, whose entities stand below `tree`."""
    views: list[tuple[str, str]]
    if platform.base.kind == "hinge":
        views = [
            ("joint angle [deg]", JOINT_ANGLE),
            ("joint rate [deg/s]", JOINT_RATE),
            ("joint torque [N m]", JOINT_TORQUE),
        ]
    else:
        views = [
            ("tilt [deg]", TILT),
            ("attitude [deg]", ATTITUDE),
            ("attitude error [deg]", ATTITUDE_ERROR),
            ("rate [deg/s]", RATE),
        ]
        if platform.wheels:
            views += [
                ("wheel speed [rpm]", WHEEL_SPEED),
                ("wheel torque [N m]", entity("command_wheel_torque")),
            ]
        if platform.stages:
            views.append(("stage position [mm]", STAGE_POSITION))
        if platform.base.travels:
            views += [("place [m]", PLACE), ("place error [mm]", PLACE_ERROR)]
        if platform.base.travels and platform.thrusters:
            views.append(("thrust [N]", entity("command_thruster")))
        views.append(("gravity torque [mN m]", GRAVITY_TORQUE))
    graphs = [_graph(title, tree + path) for title, path in views]
    graphs += _stated(streams, tree)
    return rrb.Grid(*graphs, grid_columns=1 if len(graphs) <= 3 else 2, name=name)


def _stated(streams: Mapping[str, Header], tree: str) -> list[rrb.TimeSeriesView]:
    """What an estimator states beside the motion, and its standard deviation."""
    views: list[rrb.TimeSeriesView] = []
    for sigma in (name for name in streams if name.startswith("estimate_") and is_sigma(name)):
        name, header = sigma.removesuffix(SIGMA), streams[sigma]
        words = name.removeprefix("estimate_").replace("_", " ")
        there = tree + entity(sigma)
        style = rr.SeriesLines(
            names=[f"{column}, 1 sigma" for column in header.columns],
            colors=[PALETTE[i % len(PALETTE)] for i in range(len(header.columns))],
        )
        alone = name in ("estimate_attitude", "estimate_gyro_bias")
        contents = (
            [f"/{there}"]
            if alone or name not in streams
            else [f"/{tree}{entity(name)}", f"/{there}"]
        )
        title = f"{words}, 1 sigma" if len(contents) == 1 else f"{words} and 1 sigma"
        views.append(
            _graph(f"{title} [{header.unit}]", "/", contents=contents, overrides={there: style})
        )
    return views


def _graph(title: str, path: str, **options: Any) -> rrb.TimeSeriesView:
    """Over all time."""
    endless = rrb.TimeRangeBoundary.infinite()
    return rrb.TimeSeriesView(
        origin=path,
        name=title,
        plot_legend=rrb.Corner2D.LeftTop,
        axis_x=rrb.TimeAxis(view_range=rrb.TimeRange(start=endless, end=endless)),
        **options,
    )


def _pair(
    stream: str, streams: Mapping[str, Header]
) -> tuple[rrb.TimeSeriesView, rrb.TimeSeriesView]:
    """A stream as measured and as predicted; and what is left."""
    header, residual = streams[stream], f"{RESIDUAL}{stream}"
    there = entity(f"{PREDICTED}{stream}")
    style = rr.SeriesLines(
        names=[f"{column} predicted" for column in header.columns],
        colors=[
            tuple(int(255 - PALE * (255 - part)) for part in PALETTE[i % len(PALETTE)])
            for i in range(len(header.columns))
        ],
    )
    both = _graph(
        f"{stream}, measured and predicted [{header.unit}]",
        "/",
        contents=[f"/{entity(stream)}", f"/{there}"],
        overrides={there: style},
    )
    title = f"{stream}, residual [{streams[residual].unit}]"
    return both, _graph(title, entity(residual))


def _viewpoint(platform: Platform) -> tuple[Array, Array]:
    """What the MJCF's own viewer looks at, and from there to where it stands, (3,) each [m]."""
    model = load_mjcf(platform.model_path)
    azimuth, elevation = np.radians([model.vis.global_.azimuth, model.vis.global_.elevation])
    forward = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    return model.stat.center, -1.5 * model.stat.extent * forward


def _view(name: str, center: Array, back: Array) -> rrb.Spatial3DView:
    """The 3D view, seen from there."""
    return rrb.Spatial3DView(
        origin=WORLD,
        name=name,
        eye_controls=rrb.EyeControls3D(
            position=center + back, look_target=center, eye_up=(0.0, 0.0, 1.0)
        ),
        line_grid=False,
    )
