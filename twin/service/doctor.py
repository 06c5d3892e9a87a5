"""Whether this computer is fit to fly a machine: ports, adapters, permissions, and how late it is.

Nothing is opened and nothing is changed. What is bad would keep a session from working, what is
poor would make it late.
"""

import os
import stat
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from twin.clock import WallClock

if sys.platform != "win32":
    import grp
    import resource

ADAPTERS = Path("/sys/bus/usb-serial/devices")
PROCESSOR = Path("/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor")

_LATE = 5e-3
"""[s]: a tenth of the period of a 20 Hz loop."""


class Verdict(Enum):
    """What a finding means."""

    good = "good"
    poor = "poor"
    bad = "bad"


@dataclass(frozen=True)
class DoctorFinding:
    """One thing that was looked at."""

    what: str
    verdict: Verdict
    sentence: str
    """What was found, and what would do."""


def examine(
    ports: Mapping[str, str], *, seconds: float = 3.0, rate: float = 50.0
) -> list[DoctorFinding]:
    """Look at everything.

    Args:
        ports: device -> path or URL; of the machine that is to fly, empty without one.
        seconds: for which ticks are timed [s].
        rate: of those ticks [Hz].
    """
    return [
        *(check_port(name, port) for name, port in ports.items()),
        *check_adapters(ADAPTERS),
        *check_permissions(),
        *check_governor(PROCESSOR),
        check_lateness(seconds, rate),
    ]


def check_port(name: str, port: str) -> DoctorFinding:
    """Whether a device's port is there, and ours to read and write."""
    what = f"port of {name}"
    if "://" in port:
        return DoctorFinding(
            what, Verdict.good, f"{port} is no path; whether it answers, status tells"
        )
    path = Path(port)
    if sys.platform == "win32":
        return DoctorFinding(
            what, Verdict.good, f"{port} is not looked for on Windows; status shows if it answers"
        )
    if not path.exists():
        there = ", ".join(map(str, _serial_ports())) or "none"
        return DoctorFinding(
            what, Verdict.bad, f"{port} is not there; plugged in are: {there}. Correct its port"
        )
    if not stat.S_ISCHR(path.stat().st_mode):
        return DoctorFinding(what, Verdict.bad, f"{port} is no serial port; correct its port")
    if not os.access(path, os.R_OK | os.W_OK):
        return DoctorFinding(
            what,
            Verdict.bad,
            f"{port} may not be opened; join the group {_group(path)} and log in again",
        )
    return DoctorFinding(what, Verdict.good, f"{port} -> {path.resolve()} may be opened")


def check_adapters(folder: Path) -> list[DoctorFinding]:
    """How long USB adapters hold bytes back.

    Args:
        folder: of the kernel's USB serial devices.
    """
    findings: list[DoctorFinding] = []
    for timer in sorted(folder.glob("*/latency_timer")):
        name, wait = timer.parent.name, int(timer.read_text().split()[0])
        sentence = f"holds bytes back for up to {wait} ms"
        verdict = Verdict.good if wait <= 1 else Verdict.poor
        if verdict is Verdict.poor:
            sentence += f"; as root: echo 1 > {timer}"
        findings.append(DoctorFinding(f"adapter {name}", verdict, sentence))
    return findings


def check_permissions() -> list[DoctorFinding]:
    """Whether a process may run ahead of others, and keep its memory from being swapped.

    Asked on Linux alone: other systems schedule and lock memory by other rules.
    """
    if sys.platform != "linux":
        return [
            DoctorFinding(
                "priority",
                Verdict.poor,
                f"SCHED_FIFO is Linux's, and this is {sys.platform}: keep other programs closed "
                "while a machine flies",
            )
        ]
    root = os.geteuid() == 0
    ahead = root or resource.getrlimit(resource.RLIMIT_RTPRIO)[0] != 0
    locked = resource.getrlimit(resource.RLIMIT_MEMLOCK)[0]
    enough = root or locked == resource.RLIM_INFINITY
    return [
        DoctorFinding(
            "priority",
            Verdict.good if ahead else Verdict.poor,
            "SCHED_FIFO is permitted: `twin run --realtime` keeps its time on a busy computer"
            if ahead
            else "SCHED_FIFO is not permitted; add `@realtime - rtprio 99` to "
            "/etc/security/limits.conf and join that group",
        ),
        DoctorFinding(
            "memory",
            Verdict.good if enough else Verdict.poor,
            "all of it may be locked"
            if enough
            else f"only {locked // 1024} KiB may be locked; add `@realtime - memlock unlimited`",
        ),
    ]


def check_governor(file: Path) -> list[DoctorFinding]:
    """Whether the processor slows down when there is little to do; nothing where it cannot.

    Args:
        file: in which the kernel tells its governor.
    """
    if not file.exists():
        return []
    governor = file.read_text().strip()
    fast = governor == "performance"
    sentence = f"its governor is {governor}"
    if not fast:
        sentence += "; as root: cpupower frequency-set -g performance"
    return [DoctorFinding("processor", Verdict.good if fast else Verdict.poor, sentence)]


def check_lateness(seconds: float, rate: float) -> DoctorFinding:
    """How late ticks come here now, without a load of ours.

    Args:
        seconds: for which they are timed [s].
        rate: [Hz].
    """
    clock = WallClock()
    for _ in clock.ticks(1.0 / rate, seconds):
        pass
    return judged(clock.timing.lateness, clock.timing.overruns)


def judged(lateness: Iterable[float], overruns: int) -> DoctorFinding:
    """What that lateness [s] of ticks and their overruns mean."""
    p50, p99, most = np.percentile(np.fromiter(lateness, dtype=float), [50.0, 99.0, 100.0])
    late = p99 > _LATE or overruns > 0
    sentence = (
        f"ticks come {1e3 * p50:.2f} ms late (median), {1e3 * p99:.2f} ms (99 %), "
        f"{1e3 * most:.2f} ms at most, {overruns} were missed"
    )
    if late:
        sentence += "; end what else runs, or fly with a priority of its own"
    return DoctorFinding("lateness", Verdict.poor if late else Verdict.good, sentence)


def _serial_ports() -> list[Path]:
    stable = sorted(Path("/dev/serial/by-id").glob("*"))
    return stable or sorted((*Path("/dev").glob("ttyUSB*"), *Path("/dev").glob("ttyACM*")))


def _group(path: Path) -> str:
    number = path.stat().st_gid
    if sys.platform == "win32":
        return str(number)
    try:
        return grp.getgrgid(number).gr_name
    except KeyError:
        return str(number)
