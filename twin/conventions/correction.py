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
            angles = angles @ np.array(self.axes).T
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


def attitude_of(angles: Array, sequence: str, *, world_to_body: bool) -> Array:
    """(n, 4) body to world of angles (n, 3) [rad] as they stand in the file."""
    from scipy.spatial.transform import Rotation

    turned = Rotation.from_euler(sequence, angles).as_quat(scalar_first=True)
    return rotation.continuous(rotation.conjugate(turned) if world_to_body else turned)
