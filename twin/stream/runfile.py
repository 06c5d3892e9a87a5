"""A recording as a person sees it: the streams, the machine in 3D, derived plots, a blueprint."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.recording.recording import Recording
from twin.recording.rrd import RrdFile, scalars
from twin.recording.rrd_reader import SCHEMA
from twin.stream.blueprint import SAID, Plots, Scene, blueprint, is_sigma
from twin.stream.rows import Block, Header, decode

Array = NDArray[np.float64]


class RunFile:
    """An `.rrd`, or a viewer, that receives a run."""

    def __init__(self, path: Path | None) -> None:
        """As `RrdFile`."""
        self.path = path
        self._file = RrdFile(path)
        self._widths: dict[str, int] = {}
        self._headers: dict[str, Header] = {}
        self._remarks = False
        self._platform: Platform | None = None
        self._scene: Scene | None = None
        self._plots: Plots | None = None
        self._undrawn: dict[str, list[tuple[Array, Array]]] = {}

    def start(
        self,
        platform: Platform | None,
        provenance: Mapping[str, Any],
        remarks: bool = False,
        streams: Mapping[str, Header] | None = None,
    ) -> None:
        """Write what stays the same: where it comes from, and the machine's shape; with room for
        remarks where there will be some, and for what is predicted of streams that are known."""
        self._file.provenance(provenance)
        if platform is None:
            return
        self._platform, self._remarks, self._headers = platform, remarks, dict(streams or {})
        self._scene, self._plots = Scene(platform), Plots(platform)
        self._file.rerun.send_blueprint(blueprint(platform, remarks=remarks, streams=streams))
        for path, archetype in (*self._scene.shapes(), *self._plots.styles()):
            self._file.rerun.log(path, archetype, static=True, strict=True)

    def declare(self, headers: Mapping[str, Header]) -> None:
        """Say what streams are, before their first rows; repetition does no harm."""
        for stream, header in headers.items():
            if stream not in self._widths:
                self._widths[stream] = len(header.columns)
                self._file.declare(stream, header.columns, header.unit)
        if self._platform is None or not any(map(is_sigma, headers.keys() - self._headers.keys())):
            return
        self._headers |= headers
        layout = blueprint(self._platform, remarks=self._remarks, streams=self._headers)
        self._file.rerun.send_blueprint(layout)

    def write(self, rows: Mapping[str, tuple[Array, Array]]) -> None:
        """Append rows; they are in the file on return."""
        self._file.write(rows)
        self._file.flush()
        for stream, row in rows.items():
            self._undrawn.setdefault(stream, []).append(row)

    def say(self, time: float, words: str) -> None:
        """Show words beside a moment [s]."""
        self._file.say(SAID, time, words)

    def draw(self) -> None:
        """Append what the rows since the last call show."""
        rows = {
            stream: (
                np.concatenate([time for time, _ in pieces]),
                np.concatenate([value for _, value in pieces]),
            )
            for stream, pieces in self._undrawn.items()
        }
        self._undrawn.clear()
        if self._plots is not None:
            for path, (time, value) in self._plots.derived(rows).items():
                self._file.send(scalars(path, time, value))
        if self._scene is not None:
            moved = self._scene.motion(rows)
            for path, archetype in self._scene.appeared():
                self._file.rerun.log(path, archetype, static=True, strict=True)
            self._file.send(moved)

    def write_blocks(self, blocks: Mapping[str, Block]) -> None:
        """Append rows as they came through the pipe."""
        self.write({name: decode(block, self._widths[name]) for name, block in blocks.items()})

    def flush(self) -> None:
        """Return when what was written is in the file."""
        self._file.flush()

    def close(self, ending: str = "") -> None:
        """Complete the file; `ending` says how the recording ended, if not well."""
        self.draw()
        self._file.close(ending)


def write_recording(
    recording: Recording, path: str | Path, platform: Platform | None = None
) -> None:
    """Write a recording as an `.rrd`; with its platform, the machine and the plots too.

    Raises:
        RecordingError: the file cannot be written.
    """
    file = RunFile(Path(path))
    facts = {**recording.provenance, "schema": SCHEMA}
    headers = {name: Header(s.columns, s.unit) for name, s in recording.items()}
    file.start(
        platform,
        facts | {"repairs": recording.repairs} if recording.repairs else facts,
        streams=headers,
    )
    file.declare(headers)
    file.write({name: (s.time, s.value) for name, s in recording.items()})
    file.close()
