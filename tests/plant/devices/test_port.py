"""A port belongs to one session, and what it is told to keep overwrites nothing."""

import os
import sys
import tty
from collections.abc import Iterator
from pathlib import Path

import pytest

from twin.errors import DeviceError
from twin.plant.devices.port import Port

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")


@pytest.fixture
def line() -> Iterator[str]:
    """The host's end of a pseudo-terminal."""
    master, slave = os.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(master)
    os.close(slave)


def spied(line: str, file: Path) -> Port:
    return Port("imu", f"spy://{line}?file={file}", baud=9600)


def test_a_log_overwrites_no_file_whatever_the_url_says(line, tmp_path):
    victim = tmp_path / "thesis.tex"
    victim.write_text("years of work")
    with pytest.raises(DeviceError, match=r"cannot log into .*thesis.tex; give a name that ends"):
        spied(line, victim)
    assert victim.read_text() == "years of work"
    link = tmp_path / "innocent.spy"
    link.symlink_to(victim)
    spied(line, link).close()
    assert victim.read_text() == "years of work"


def test_each_session_keeps_the_logs_of_those_before(line, tmp_path):
    for _ in range(3):
        port = spied(line, tmp_path / "imu.spy")
        port.write(b"hello")
        port.close()
    names = sorted(path.name for path in tmp_path.iterdir())
    assert names == ["imu-2.spy", "imu-3.spy", "imu.spy"]
    assert all("hello" in path.read_text() for path in tmp_path.iterdir())


def test_a_port_that_is_logged_is_as_exclusive_as_any(line, tmp_path):
    first = spied(line, tmp_path / "imu.spy")
    for url in (line, f"spy://{line}", f"spy://{line}?file={tmp_path / 'imu.spy'}"):
        with pytest.raises(DeviceError, match="close the other program that has it open"):
            Port("imu", url, baud=9600)
    assert [path.name for path in tmp_path.iterdir()] == ["imu.spy"], "no empty log is left"
    first.close()
    Port("imu", line, baud=9600).close()


def test_a_scheme_that_nobody_knows_is_refused_by_name(tmp_path):
    with pytest.raises(DeviceError, match=r"no such kind of port; give a path, or spy://"):
        Port("imu", f"file://{tmp_path}/x", baud=9600)
