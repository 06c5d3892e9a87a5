"""What is seen of a machine on its bench while it flies, and the key that stops it."""

import io
import os
import pty
import subprocess
import sys

import numpy as np
import pytest

from tests.processes import running, wait_until
from twin.bench import open_bench
from twin.cli.live import LiveView
from twin.controller.load import load_controller
from twin.estimators.named import load_estimator
from twin.loop import Ended, fly
from twin.plant.guard.guarded import Held
from twin.platform import load_platform
from twin.reference import Hold

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_state_tilt_masses_lateness_and_lines_are_shown_and_nothing_where_nobody_looks():
    out, nobody = Terminal(), io.StringIO()
    with open_bench(load_platform("cubesat"), "pty", held=Held.floating, lockstep=True) as bench:
        clock = bench.begin()
        with LiveView(bench, 20.0, out) as view, LiveView(bench, 20.0, nobody) as unseen:
            assert view.words() == []
            law, estimator = load_controller("mass_magnetic_pid"), load_estimator("filter")
            outcome = fly(
                bench, estimator, law, Hold(), clock, duration=5.0, observers=[view, unseen]
            )
            told = view.words()
            # by the thread that looks twice a second
            wait_until(lambda: "armed, floating" in out.getvalue())
    assert outcome.ended is Ended.done
    assert told[0].startswith("armed, floating: 5.0 s, 15 s left; tilt ")
    assert told[1].startswith("masses s1 ")
    assert "ms late (median), 0.0 ms at most" in told[2], "in lockstep nothing is late"
    assert told[3].startswith("feather: ")
    assert "no emergency stop" in told[-1]
    assert nobody.getvalue() == ""


@pytest.mark.parametrize("keys", [b" ", b"x y"], ids=["alone", "among other keys"])
def test_the_space_bar_stops_a_run_safely_and_gives_the_terminal_back(keys: bytes):
    words = ["run", "cubesat", "--plant", "pty", "--lockstep", "--arm", "floating"]
    ours, theirs = pty.openpty()
    words += ["--duration", "100000"]
    command = [sys.executable, "-m", "twin", *words]
    with running(command, stdin=theirs, stdout=subprocess.PIPE, stderr=theirs) as run:
        os.close(theirs)
        seen = b""
        try:
            while b"armed, floating: " not in seen:
                seen += os.read(ours, 4096)
            os.write(ours, keys)
            while True:
                # what it still says must not fill the terminal
                seen += os.read(ours, 4096)
        except OSError:
            pass  # it has ended, and its end of the terminal with it
        finally:
            os.close(ours)
        assert run.stdout is not None
        told = run.stdout.read().decode()
        assert run.wait() == 0, seen.decode()
    assert "safe_stop" in told
    assert "stopped by the operator" in told


def test_when_the_wheels_will_be_full_is_told():
    from twin.cli.live import _saturation
    from twin.signals import Tick

    sads = load_platform("sads")
    limit = sads.wheels[0].momentum_limit
    torque = np.array([[0.0, -0.1, 0.0]])
    tick = Tick(None, None, None, {}, {"command_wheel_torque": torque}, {})  # type: ignore[arg-type]
    told = _saturation(sads, np.array([0.0, 0.5 * limit, 0.0]), tick)
    name = sads.wheels[1].name
    assert told == f"wheels 50 % full; {name} is full in {1.5 * limit / 0.1:.0f} s"
