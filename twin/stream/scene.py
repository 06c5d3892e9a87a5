"""The machine in 3D: the MJCF's own visible geoms on entities that follow its body tree.

The bus turns with the attitude (or the hinge angle), the stages slide, gimbals turn, and what
floats away goes where the CR goes; wheels are drawn at rest.
"""

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from twin import rotation
from twin.platform import Platform
from twin.platform.mjcf import load_mjcf
from twin.recording.rrd import timeline

Array = NDArray[np.float64]

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
