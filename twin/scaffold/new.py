"""Copy a template under a new name. The templates beside this file are platforms themselves."""

import re
import shutil
from pathlib import Path

import numpy as np

from twin.errors import UnknownName, UsageError
from twin.library import model_names
from twin.noise import measure_noise
from twin.recording import Recording

KINDS = {
    "table": "a table on a ball bearing: three wheels, three sliding masses, gyro, attitude sensor",
    "pendulum": "a body on a hinge, with an encoder",
    "free": "a body that is thrown, with a wheel, a gyro and motion capture",
}
"""Template folders, and what they hold."""

_STEP, _CONTROL = r"(?m)^step = ([\d.]+)", r"(?m)^control_rate = ([\d.]+)"
_HERE = Path(__file__).parent
_TEMPLATE_NAME = "my-machine"
"""Name of the machine inside the templates' files."""


SENSORS = {
    "table": ("gyro", "attitude", "inclinometer", "accelerometer", "magnetometer", "wheel_speed")
    + ("stage_position",),
    "pendulum": ("joint_angle", "joint_rate"),
    "free": ("gyro", "attitude", "magnetometer", "position", "wheel_speed"),
}
"""Streams that a machine of each kind can have a sensor for."""
OF_PARTS = ("wheel_speed", "stage_position")
AT_SITE = ("accelerometer", "inclinometer")
"""Sensors that are somewhere on the body."""


def sensors_of(recording: Recording, kind: str) -> str:
    """[sensors.NAME] of a platform.toml: rate and noise as the log has them.

    Raises:
        UsageError: the log has no stream of a sensor that such a machine can have.
    """
    tables = list[str]()
    for name in SENSORS[kind]:
        if name not in recording or len(recording[name]) < 2 or recording[name].stands_still:
            continue
        series, noise = recording[name], measure_noise(recording[name])
        clock = noise.clock.period
        white = f"[{', '.join(f'{sigma:.3g}' for sigma in noise.white)}]"
        if name in OF_PARTS:  # the machine may have another number of them
            white = f"{float(noise.white.max()):.3g}"
        lines = [
            f"[sensors.{name}]",
            f"rate = {1.0 / clock:.4g}  # Hz, of the log",
            f"noise = {white}  # {series.unit}, 1 sigma a sample, of the log",
        ]
        if noise.quantised.any() and name != "attitude":
            lines.append(f"resolution = {float(noise.resolution.max()):.3g}  # of the log's steps")
        if name in AT_SITE:
            lines.append('site = "imu"  # of platform.xml: where it is on the body')
        tables.append("\n".join(lines))
    if not tables:
        listed = ", ".join(SENSORS[kind])
        raise UsageError(
            f"{recording.source} has no stream of a sensor of a {kind}: {listed}; name another kind"
        )
    return "\n\n".join(tables) + "\n"


def _step_for(log: Recording, kind: str) -> str | None:
    """A step [s] as short as the period of the log's fastest sensor, which goes into the period of
    the control; None where that of the template is short enough."""
    text = (_HERE / kind / "platform.toml").read_text(encoding="utf-8")
    (step,), (control,) = (map(float, re.findall(p, text)) for p in (_STEP, _CONTROL))
    fastest = max(log[name].rate for name in SENSORS[kind] if name in log)
    if fastest * step <= 1.0 + 1e-6:
        return None
    return repr(float(1.0 / (control * np.ceil(fastest / control - 1e-6))))


def new_platform(path: Path, kind: str, log: Recording | None = None) -> Path:
    """Write a platform folder of that kind; its last part is the machine's name.

    Args:
        path: of the folder.
        kind: one of KINDS.
        log: what the machine recorded: its sensors, their rates and their noise.

    Raises:
        UnknownName: no such kind.
        UsageError: the folder exists, its name is no name for a machine, or the log has no sensor
            of such a machine.
    """
    if kind not in KINDS:
        raise UnknownName("kind of machine", kind, KINDS)
    sensors = None if log is None else sensors_of(log, kind)
    step = None if log is None else _step_for(log, kind)
    name = path.name
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_-]*", name):
        raise UsageError(
            f"a machine cannot be called {name!r}: begin with a letter, go on with letters, "
            "digits, - and _"
        )
    if name in model_names():
        raise UsageError(f"{name!r} is a machine that is shipped; choose another name")
    try:
        path.mkdir(parents=True)
    except FileExistsError:
        raise UsageError(f"{path} is there already; choose another name, or move it away") from None
    except OSError as problem:
        raise UsageError(f"cannot write {path}: {problem.strerror}") from None
    try:
        for file in sorted((_HERE / kind).iterdir()):
            text = file.read_text(encoding="utf-8").replace(_TEMPLATE_NAME, name)
            if sensors is not None and file.name == "platform.toml":
                text = text[: text.index("[sensors.")] + sensors
            if step is not None:
                text = re.sub(_STEP, f"step = {step}", text)
                text = re.sub(r'timestep="[\d.]+"', f'timestep="{step}"', text)
            (path / file.name).write_text(text, encoding="utf-8")
    except OSError as problem:
        shutil.rmtree(path, ignore_errors=True)
        raise UsageError(f"cannot write {path}: {problem.strerror}") from None
    return path
