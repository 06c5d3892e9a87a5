"""Status of a machine on its bench during a flight, in the terminal, and a key that stops it.

The loop only stores its last tick here and a thread prints it, so that a slow terminal does not
delay the loop. Nothing is printed where stderr is no terminal.
"""

import os
import sys
import threading
from collections import deque
from contextlib import ExitStack
from typing import TYPE_CHECKING, Self, TextIO

import numpy as np

from twin.bench import Bench
from twin.cli.output import printable, terminal
from twin.signals import Tick
from twin.stop import request

if TYPE_CHECKING:
    from twin.platform import Platform

KEY = b" "
"""Stops safely, as Ctrl-C does. It is no emergency stop."""

_PERIOD = 0.5
"""Between two looks [s]."""

_LATENESS = 400
"""Ticks whose lateness is printed."""


class LiveView:
    """Observer of a loop."""

    def __init__(self, bench: Bench, duration: float, out: TextIO | None = None) -> None:
        """Nothing is written before it is entered.

        Args:
            bench: which flies.
            duration: for which it is to fly [s].
            out: stderr unless given; it must be a terminal to be written to.
        """
        self._bench, self._duration = bench, duration
        self._out = terminal(out or sys.stderr)
        self._shown = self._out.isatty()
        self._tick: Tick | None = None
        self._late = deque[float](maxlen=_LATENESS)
        self._lines = 0
        self._ending = threading.Event()
        self._stack = ExitStack()

    def __enter__(self) -> Self:
        if self._shown:
            threading.Thread(target=self._write, name="live view", daemon=True).start()
            if sys.stdin.isatty() and sys.platform != "win32":
                self._listen()
        return self

    def __exit__(self, *error: object) -> None:
        self._ending.set()
        self._stack.close()

    def collect(self, tick: Tick) -> None:
        """One tick."""
        self._late.append(self._bench.late(tick.reading.time))
        self._tick = tick

    def words(self) -> list[str]:
        """The lines to print; none before the first tick."""
        tick, bench = self._tick, self._bench
        if tick is None:
            return []
        guard, state = bench.guard, bench.guard.seen
        time = tick.reading.time
        floats = "floating" if guard.floating else "captured"
        remaining = max(self._duration - time, 0.0)
        lines = [f"{guard.phase.name}, {floats}: {time:.1f} s, {remaining:.0f} s left"]
        lean = state.lean
        if lean is not None:
            limit = np.degrees(guard.settings.tilt_cutout)
            lines[0] += f"; tilt {np.degrees(lean):.2f} of {limit:.0f} deg"
        if state.stage_position is not None:
            names = bench.platform.columns("stage_position")
            places = zip(names, 1e3 * state.stage_position, strict=True)
            lines.append("masses " + ", ".join(f"{name} {place:.3f}" for name, place in places))
            lines[-1] += " mm"
        saturation = _saturation(bench.platform, state.wheel_momentum, tick)
        if saturation:
            lines.append(saturation)
        late = 1e3 * np.array(self._late)
        lines.append(f"ticks {np.median(late):.1f} ms late (median), {late.max():.1f} ms at most")
        lines += [f"{name}: {c.words()}" for name, c in bench.hardware.counters.items()]
        keys = "Ctrl-C" if sys.platform == "win32" else "space or Ctrl-C"
        return [*lines, f"{keys} stops safely; it is no emergency stop"]

    def _write(self) -> None:
        while not self._ending.wait(_PERIOD):
            lines = self.words()
            up = f"\x1b[{self._lines}A" if self._lines else ""
            self._lines = len(lines)
            self._out.write(up + "".join(f"\x1b[K{printable(line)}\n" for line in lines))
            self._out.flush()

    def _listen(self) -> None:
        """Take keys as they are pressed; the terminal is put back in the end."""
        if sys.platform == "win32":
            return
        import select
        import termios
        import tty

        terminal = sys.stdin.fileno()
        before = termios.tcgetattr(terminal)
        self._stack.callback(termios.tcsetattr, terminal, termios.TCSADRAIN, before)
        tty.setcbreak(terminal)

        def hear() -> None:
            while not self._ending.is_set():
                if not select.select([terminal], [], [], _PERIOD)[0]:
                    continue
                # past Python's buffer, where a key behind another one would wait unseen
                pressed = os.read(terminal, 64)
                if KEY in pressed:
                    request()
                if KEY in pressed or not pressed:
                    return

        threading.Thread(target=hear, name="stop key", daemon=True).start()


def _saturation(platform: "Platform", momentum: np.ndarray, tick: Tick) -> str:
    """When the first wheel will be full under the torque of now; empty without wheels."""
    torque = tick.applied.get("command_wheel_torque")
    if torque is None or "wheel_speed" not in platform.sensors:
        return ""
    limit = np.array([wheel.momentum_limit for wheel in platform.wheels])
    with np.errstate(divide="ignore"):
        remaining = (limit - np.sign(torque[0]) * momentum) / np.abs(torque[0])
    first = int(np.argmin(remaining))
    held = 100.0 * np.max(np.abs(momentum) / limit)
    when = f"{platform.wheels[first].name} is full in {max(remaining[first], 0.0):.0f} s"
    return f"wheels {held:.0f} % full" + (f"; {when}" if np.isfinite(remaining[first]) else "")
