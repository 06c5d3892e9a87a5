"""A recording as a person sees it: the streams, the machines in 3D, derived plots, a blueprint."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from twin.platform import Platform
from twin.recording.recording import Recording
from twin.recording.rrd import RrdFile, scalars, tree_of
from twin.recording.rrd_reader import SINGLE_MACHINE
from twin.stream.blueprint import (
    SAID,
    WORLD,
    Plots,
    Scene,
    blueprint,
    is_sigma,
    layout_of_several,
)
from twin.stream.rows import Block, Header, Placed, decode

Array = NDArray[np.float64]


class RunFile:
    """An `.rrd`, or a viewer, that receives a run."""

    def __init__(self, path: Path | None) -> None:
        """As `RrdFile`."""
        self.path = path
        self._file = RrdFile(path)
        self._trees: dict[str, _Tree] = {}
        self._remarks = False

    def start(
        self,
        machines: Platform | Mapping[str, Placed] | None,
        provenance: Mapping[str, Any],
        remarks: bool = False,
        streams: Mapping[str, Header] | None = None,
    ) -> None:
        """Write what stays the same: where it comes from, and the machines' shapes; with room for
        remarks where there will be some, and for what is predicted of streams that are known.

        Args:
            machines: the machine; of several each by its name; None where it is not known.
            provenance: of the recording.
            remarks: whether `say` will be called.
            streams: of a single machine.
        """
        self._file.provenance(provenance)
        self._remarks = remarks
        if isinstance(machines, Mapping):
            self._trees = {
                name: _Tree(self._file, name, placed, [n for n in machines if n != name])
                for name, placed in machines.items()
            }
            world = rr.ViewCoordinates.RIGHT_HAND_Z_UP
            self._file.rerun.log(WORLD, world, static=True, strict=True)
        else:
            self._trees = {"": _Tree(self._file, "", Placed(machines), ())}
        for tree in self._trees.values():
            tree.shown.streams.update(streams or {})
            tree.begin()
        self._arrange()

    def _arrange(self) -> None:
        """Send the layout of what is known of the streams."""
        shown = {name: tree.shown for name, tree in self._trees.items()}
        if "" not in shown:
            layout = layout_of_several(shown, remarks=self._remarks)
        elif shown[""].platform is None:
            return
        else:
            layout = blueprint(shown[""].platform, remarks=self._remarks, streams=shown[""].streams)
        self._file.rerun.send_blueprint(layout)

    def declare(self, headers: Mapping[str, Header], machine: str = "") -> None:
        """Say what streams are, before their first rows; repetition does no harm."""
        if self._trees[machine].declare(headers):
            self._arrange()

    def write(self, rows: Mapping[str, tuple[Array, Array]], machine: str = "") -> None:
        """Append rows; they are in the file on return."""
        self._trees[machine].write(rows)
        self._file.flush()

    def say(self, time: float, words: str) -> None:
        """Show words beside a moment [s]."""
        self._file.say(SAID, time, words)

    def draw(self) -> None:
        """Append what the rows since the last call show."""
        for tree in self._trees.values():
            tree.draw()

    def write_blocks(self, blocks: Mapping[str, Block], machine: str = "") -> None:
        """Append rows as they came through the pipe."""
        widths = self._trees[machine].widths
        rows = {name: decode(block, widths[name]) for name, block in blocks.items()}
        self.write(rows, machine)

    def flush(self) -> None:
        """Return when what was written is in the file."""
        self._file.flush()

    def close(self, ending: str = "") -> None:
        """Complete the file; `ending` says how the recording ended, if not well."""
        self.draw()
        self._file.close(ending)


class _Tree:
    """The entities of one machine in a file."""

    def __init__(
        self,
        file: RrdFile,
        name: str,
        placed: Placed,
        others: Sequence[str],
    ) -> None:
        platform = placed.platform
        self.shown = replace(placed, streams=dict(placed.streams))
        self.widths: dict[str, int] = {}
        self._file, self._tree = file, tree_of(name)
        self._root = f"{WORLD}/{self._tree}".rstrip("/")
        self._scene = None if platform is None else Scene(platform, self._root)
        self._plots = None if platform is None else Plots(platform, others)
        self._undrawn: dict[str, list[tuple[Array, Array]]] = {}

    def begin(self) -> None:
        """Write what stays the same."""
        if self._scene is None or self._plots is None:
            return
        rerun = self._file.rerun
        for path, archetype in self._scene.shapes():
            rerun.log(path, archetype, static=True, strict=True)
        for path, archetype in self._plots.styles():
            rerun.log(self._tree + path, archetype, static=True, strict=True)
        if self._tree:
            stands = rr.Transform3D(translation=self.shown.origin)
            rerun.log(self._root, stands, static=True, strict=True)

    def declare(self, headers: Mapping[str, Header]) -> bool:
        """As of `RunFile`; whether the layout has more to show."""
        for stream, header in headers.items():
            if stream not in self.widths:
                self.widths[stream] = len(header.columns)
                self._file.declare(stream, header.columns, header.unit, self._tree)
        fresh = headers.keys() - self.shown.streams.keys()
        if self.shown.platform is None or not any(map(is_sigma, fresh)):
            return False
        self.shown.streams.update(headers)
        return True

    def write(self, rows: Mapping[str, tuple[Array, Array]]) -> None:
        """Append rows."""
        self._file.write(rows, self._tree)
        for stream, row in rows.items():
            self._undrawn.setdefault(stream, []).append(row)

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
                self._file.send(scalars(self._tree + path, time, value))
        if self._scene is not None:
            moved = self._scene.motion(rows)
            for path, archetype in self._scene.appeared():
                self._file.rerun.log(path, archetype, static=True, strict=True)
            self._file.send(moved)


def write_recording(
    recording: Recording, path: str | Path, platform: Platform | None = None
) -> None:
    """Write a recording as an `.rrd`; with its platform, the machine and the plots too.

    Raises:
        RecordingError: the file cannot be written.
    """
    file = RunFile(Path(path))
    facts = {**recording.provenance, "schema": SINGLE_MACHINE}
    headers = {name: Header(s.columns, s.unit) for name, s in recording.items()}
    file.start(
        platform,
        facts | {"repairs": recording.repairs} if recording.repairs else facts,
        streams=headers,
    )
    file.declare(headers)
    file.write({name: (s.time, s.value) for name, s in recording.items()})
    file.close()
