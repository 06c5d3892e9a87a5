"""One wrong convention of one stream, and how its values and stamps are put right."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.recording import Recording, Series

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Correction:
    """right value = factor * axes @ value read, true at time_factor * stamp - lag."""

    stream: str
    kind: str
    """`unit`, `axes`, `frame`, `order`, `direction`, `angles`, `time_unit`, `clock_lag`
    or `no_fit`, which corrects nothing."""
    words: str
    """What is wrong, without a capital or a full stop: "gyro looks like deg/s, read as rad/s".
    Empty for the further streams of a frame, which the first one's words name."""
    keys: tuple[tuple[str, str], ...] = ()
    """Keys of [streams.<stream>] in log.toml with the right text. Columns, rate and clock_lag
    depend on what stands there; `log_toml.py` works them out."""
    cost: float = 0.0
    """How unusual the mistake is [nats]."""
    factor: float = 1.0
    axes: tuple[tuple[float, ...], ...] = ()
    """Square, as wide as the stream; empty: as they are."""
    time_factor: float = 1.0
    lag: float = 0.0
    """[s], positive: stamped late."""
    sequence: str = ""
    """Of Euler angles ("ZYX"), whose file has them: `axes` (3, 3) are of these angles then."""
    world_to_body: bool = False
    """Whether these angles turn world components into body components."""

    def apply(self, series: Series) -> Series:
        """The stream as it should have been read."""
        value = series.value
        if self.sequence:
            backwards = self.world_to_body
            angles = angles_of(value, self.sequence, world_to_body=backwards)
            angles = right_angles(angles, np.array(self.axes), self.sequence)
            value = attitude_of(angles, self.sequence, world_to_body=backwards)
        elif self.axes:
            value = value @ np.array(self.axes).T
        if self.factor != 1.0:
            value = value * self.factor
        return replace(series, time=series.time * self.time_factor - self.lag, value=value)


def apply_all(recording: Recording, corrections: Iterable[Correction]) -> Recording:
    """The recording with every named stream corrected, in the order given."""
    streams: dict[str, Series] = dict(recording.streams)
    for correction in corrections:
        if correction.stream in streams:
            streams[correction.stream] = correction.apply(streams[correction.stream])
    return replace(recording, streams=streams)


def stated(recording: Recording, stream: str) -> Mapping[str, object]:
    """What log.toml says of a stream; empty for a recording of our own."""
    streams = recording.provenance.get("streams") or {}
    return streams.get(stream) or {}


def as_tuple(axes: Array) -> tuple[tuple[float, ...], ...]:
    """A matrix that a frozen dataclass can hold."""
    return tuple(tuple(float(entry) for entry in row) for row in axes)


def angles_of(value: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 3) [rad] that stand in the file for attitudes (n, 4), which turn body to world."""
    from scipy.spatial.transform import Rotation

    turned = rotation.conjugate(value) if world_to_body else value
    with warnings.catch_warnings():
        # a gimbal lock: one of the angles is free there, and taken as 0
        warnings.simplefilter("ignore", UserWarning)
        return np.asarray(Rotation.from_quat(turned, scalar_first=True).as_euler(sequence))


def right_angles(angles: Array, axes: Array, sequence: str) -> Array:
    """(n, 3) [rad] that are `axes` (3, 3) times those of the file.

    Two triples give each attitude, and `angles` (n, 3) are the one whose middle angle is the
    smaller. The file has that of the two whose right middle angle is in its range, for it was
    written in the right order: angles in a wrong one may well have a middle angle beyond 90 deg.
    """
    same_ends = sequence[0] == sequence[2]
    mirrored = -angles[:, 1] if same_ends else np.pi - angles[:, 1]
    other = np.column_stack([angles[:, 0] + np.pi, mirrored, angles[:, 2] + np.pi])
    right, turned = angles @ axes.T, other @ axes.T
    # between 0 and 180 deg where the first and the last axis are one, else within 90 deg of 0
    within = np.sin(right[:, 1]) >= 0.0 if same_ends else np.cos(right[:, 1]) >= 0.0
    return np.where(within[:, None], right, turned)


def attitude_of(angles: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 4) body to world of angles (n, 3) [rad] as they stand in the file."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler(sequence, angles).as_quat(scalar_first=True)
    return rotation.continuous(rotation.conjugate(turned) if world_to_body else turned)
