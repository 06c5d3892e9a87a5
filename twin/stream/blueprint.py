"""What a person sees on opening a recording: the machine in 3D beside its plots.

The machine in 3D: the MJCF's own visible geoms on entities that follow its body tree.
The bus turns with the attitude (or the hinge angle), the stages slide, gimbals turn, and what
floats away goes where the CR goes; wheels are drawn at rest.
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
from twin.recording.rrd import PALETTE, entity, timeline
from twin.recording.rrd_reader import TIMELINE
from twin.signals import PREDICTED, RESIDUAL
from twin.stream.rows import Header

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
            if (result := _first_of(rows, *streams)) is not None:
                yield path, (result[0], factor * result[1])

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


WORLD = "world"

_ATTITUDES = ("estimate_attitude", "attitude", "truth_attitude")
_ANGLES = ("joint_angle", "truth_joint_angle")
_POSITIONS = ("stage_position", "truth_stage_position", "command_stage_position")
_GIMBALS = ("gimbal_angle", "truth_gimbal_angle")
_HEADINGS = ("truth_heading",)
_PLACES = ("position", "truth_position")
"""Streams that move the machine; the first that is there does."""

_HIDDEN_GROUP = 3
"""MuJoCo's viewer shows geoms of the groups below this one."""

_BOUNDLESS = 2.0
"""Half the side of a plane that has no end [m]."""

_FLAT = 1e-3
"""Half the thickness that a plane is drawn with [m]."""


class Scene:
    """One platform, drawn."""

    def __init__(self, platform: Platform) -> None:
        self._platform = platform
        self._model = load_mjcf(platform.model_path)
        self._paths = _body_paths(self._model)
        base = platform.base
        self._base = base
        self._parts = (
            ((base.joint,), _ANGLES if base.kind == "hinge" else _ATTITUDES),
            (tuple(stage.name for stage in platform.stages), _POSITIONS),
            (tuple(gimbal.name for gimbal in platform.gimbals), _GIMBALS),
            (base.planar[2:], _HEADINGS),
        )
        """Joints, and the streams that move them, the best first."""
        self._joints = [joint for joints, _ in self._parts for joint in joints]
        self._carried = base.joint if base.kind == "free" else (*base.planar, "")[0]
        """The joint whose body goes where the CR goes; empty where the CR stands."""
        self._chosen: dict[tuple[str, ...], str] = {}
        self._placed = False

    def shapes(self) -> Iterator[tuple[str, rr.AsComponents]]:
        """What does not change: entity path and archetype."""
        model = self._model
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
            ids = np.arange(model.ngeom)[model.geom_bodyid == body]
            shown = [int(i) for i in ids if model.geom_group[i] < _HIDDEN_GROUP]
            for kind in sorted({int(model.geom_type[i]) for i in shown}):
                same = [i for i in shown if model.geom_type[i] == kind]
                yield from _shapes(model, self._paths[body], mujoco.mjtGeom(kind), same)

    def motion(self, rows: Mapping[str, tuple[Array, Array]]) -> list[Chunk]:
        """Where the moving bodies are, at the times of the rows."""
        chunks: list[Chunk] = []
        starts = [time[0] for time, _ in rows.values() if len(time)]
        if not self._placed and starts:
            # A body whose stream is never recorded stays where the MJCF has it.
            self._placed = True
            start = np.array([min(starts)])
            for name in self._joints:
                rest = self._model.qpos0[self._model.joint(name).qposadr[0]]
                chunks.append(self._moved(name, start, np.array([rest])))
            if self._carried:
                chunks.append(self._carried_to(start, self._anchor()[None]))
        for joints, streams in self._parts:
            stream = self._stream(streams, rows)
            if stream is None:
                continue
            time, value = rows[stream]
            if stream in _ATTITUDES:
                chunks.append(self._turned(joints[0], time, value))
            else:
                chunks += [self._moved(n, time, value[:, i]) for i, n in enumerate(joints)]
        place = self._stream(_PLACES, rows) if self._carried else None
        if place is not None:
            chunks.append(self._carried_to(*rows[place]))
        return chunks

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

    def _carried_to(self, time: Array, place: Array) -> Chunk:
        """The body that carries the CR, which is at `place` (m, 3) in the room [m]."""
        body = int(self._model.jnt_bodyid[self._model.joint(self._carried).id])
        translation = self._model.body_pos[body] + place - self._anchor()
        if self._base.kind == "free":  # its attitude is told apart
            columns = rr.Transform3D.columns(translation=translation)
        else:
            turn = np.tile(self._model.body_quat[body], (len(time), 1))
            columns = rr.Transform3D.columns(translation=translation, quaternion=_xyzw(turn))
        return Chunk.from_columns(self._paths[body], indexes=[timeline(time)], columns=columns)

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

    def _turned(self, joint: str, time: Array, turn: Array) -> Chunk:
        """About the joint's anchor, which stays where it is."""
        model = self._model
        number = model.joint(joint).id
        body, anchor = model.jnt_bodyid[number], model.jnt_pos[number]
        quat = rotation.multiply(model.body_quat[body], turn)
        fixed = model.body_pos[body] + rotation.rotate(model.body_quat[body], anchor)
        return self._chunk(number, time, fixed - rotation.rotate(quat, anchor), quat)

    def _chunk(self, joint: int, time: Array, position: Array, quat: Array) -> Chunk:
        path = self._paths[int(self._model.jnt_bodyid[joint])]
        if self._model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:  # its place is told apart
            columns = rr.Transform3D.columns(quaternion=_xyzw(quat))
        else:
            columns = rr.Transform3D.columns(translation=position, quaternion=_xyzw(quat))
        return Chunk.from_columns(path, indexes=[timeline(time)], columns=columns)


def _body_paths(model: mujoco.MjModel) -> list[str]:
    """Entity path of every body, by id."""
    paths = [WORLD]
    for body in range(1, model.nbody):
        name = rr.escape_entity_path_part(model.body(body).name or f"body{body}")
        paths.append(f"{paths[int(model.body_parentid[body])]}/{name}")
    return paths


def _shapes(
    model: mujoco.MjModel, path: str, kind: mujoco.mjtGeom, ids: Sequence[int]
) -> Iterator[tuple[str, rr.AsComponents]]:
    """The geoms of one kind on one body, as one archetype; meshes one by one."""
    center, quat, size = model.geom_pos[ids], model.geom_quat[ids], model.geom_size[ids]
    color = _colors(model, ids)
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
            for i in ids:
                yield f"{path}/mesh{i}", _mesh(model, i)
        case _:
            pass  # height fields and signed distance fields have no counterpart


def _mesh(model: mujoco.MjModel, geom: int) -> rr.Mesh3D:
    mesh = model.mesh(int(model.geom_dataid[geom])).id
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[first : first + count].astype(np.float64)
    face, faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return rr.Mesh3D(
        vertex_positions=model.geom_pos[geom] + rotation.rotate(model.geom_quat[geom], vertices),
        triangle_indices=model.mesh_face[face : face + faces],
        albedo_factor=_colors(model, [geom])[0],
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


PALE = 0.4
"""How much of its colour a predicted curve keeps, beside the measured one."""


def blueprint(
    platform: Platform, *, remarks: bool = False, streams: Mapping[str, Header] | None = None
) -> rrb.Blueprint:
    """The layout for a platform: only plots of what it has.

    Args:
        platform: what is seen.
        remarks: whether there is a place for what is said, below the machine.
        streams: of the recording, where they are known; what is there as measured, predicted and
            left is shown so, in front of the flight's plots.
    """
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
                ("wheel speed [rad/s]", WHEEL_SPEED),
                ("wheel torque [N m]", entity("command_wheel_torque")),
            ]
        if platform.stages:
            views.append(("stage position [mm]", STAGE_POSITION))
        views.append(("gravity torque [mN m]", GRAVITY_TORQUE))
    graphs = [_graph(title, path) for title, path in views]
    flight = rrb.Grid(*graphs, grid_columns=1 if len(graphs) <= 3 else 2, name="the flight")
    shown: rrb.Grid | rrb.Tabs = flight
    known = streams or {}
    predicted = [name for name in known if f"{PREDICTED}{name}" in known]
    if predicted:
        pairs = [view for stream in predicted for view in _pair(stream, known)]
        compared = rrb.Grid(*pairs, grid_columns=2, name="measured, predicted, left")
        shown = rrb.Tabs(compared, flight, active_tab=0)
    scene: rrb.Spatial3DView | rrb.Vertical = _machine(platform)
    if remarks:
        words = rrb.TextLogColumns(text_log_columns=["body"])
        said = rrb.TextLogView(origin=SAID, name="what was said", columns=words)
        scene = rrb.Vertical(scene, said, row_shares=[3, 1])
    return rrb.Blueprint(
        rrb.Horizontal(scene, shown, column_shares=[2, 3]),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed"),
        rrb.SelectionPanel(state="hidden"),
        rrb.BlueprintPanel(state="collapsed"),
        auto_views=False,
    )


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
    left = f"{stream}, what is left [{streams[residual].unit}]"
    return both, _graph(left, entity(residual))


def _machine(platform: Platform) -> rrb.Spatial3DView:
    """The 3D view, seen from where the MJCF's own viewer stands."""
    model = load_mjcf(platform.model_path)
    center, distance = model.stat.center, 1.5 * model.stat.extent
    azimuth, elevation = np.radians([model.vis.global_.azimuth, model.vis.global_.elevation])
    forward = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.cos(elevation) * np.sin(azimuth),
            np.sin(elevation),
        ]
    )
    return rrb.Spatial3DView(
        origin=WORLD,
        name=platform.title,
        eye_controls=rrb.EyeControls3D(
            position=center - distance * forward, look_target=center, eye_up=(0.0, 0.0, 1.0)
        ),
        line_grid=False,
    )
