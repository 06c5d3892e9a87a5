"""Where Linux's modules are absent, the package imports, flies, and says what is not there."""

import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from tests.processes import PATIENCE
from twin.platform import load_platform
from twin.recording import read_recording
from twin.stream import recorder
from twin.stream.recorder import FileRecorder

ELSEWHERE = """
import importlib, pkgutil, sys
import twin

def everything():
    for module in pkgutil.walk_packages(twin.__path__, "twin."):
        if module.name != "twin.__main__":
            importlib.import_module(module.name)

everything()  # with what other packages need of this system
for name in [name for name in sys.modules if name.split(".")[0] == "twin"]:
    del sys.modules[name]
for name in ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty"):
    sys.modules[name] = None
sys.platform = "win32"
import twin
everything()
run = twin.fly("sads", "quaternion_pd", duration=1.0)
assert run.recording.stop > 0.9
try:
    twin.fly("astros", plant="pty", duration=1.0)
except twin.TwinError as problem:
    print(problem)
from twin.service.doctor import check_permissions
print(*check_permissions())
"""


@pytest.mark.slow(10)
def test_the_package_imports_and_flies_without_the_modules_of_unix():
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], capture_output=True, text=True, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr
    assert "Windows has no pseudo-terminals" in done.stdout
    assert "SCHED_FIFO is Linux's" in done.stdout


def test_a_recording_is_whole_where_pipes_must_be_waited_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    import twin

    monkeypatch.setattr(recorder, "_THREADED", True)
    path = tmp_path / "a.rrd"
    run = twin.fly(load_platform("dfki_pendulum"), duration=3.0, rrd=path)
    kept = read_recording(path)
    assert set(kept) >= set(run.recording)
    for name, series in run.recording.items():
        assert np.array_equal(kept[name].value, series.value), name


def say_on(writer: FileRecorder) -> None:
    for _ in range(1000):
        writer.say(0.0, "x" * 1000)
        time.sleep(0.01)


def test_a_writer_that_has_gone_is_noticed_where_pipes_must_be_waited_for(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
):
    monkeypatch.setattr(recorder, "_THREADED", True)
    platform = load_platform("dfki_pendulum")
    writer = FileRecorder(tmp_path / "a.rrd")
    writer.start(platform, {})
    writer._writer._process.kill()
    writer._writer._process.wait()
    with pytest.raises(recorder.RecordingError, match="has ended"):
        say_on(writer)
    with suppress(recorder.RecordingError):
        writer.close()
