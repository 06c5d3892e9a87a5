"""A PX4 log (`.ulg`) with pyulog: fields by topic, as `sensor_combined.gyro_rad.1`."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np

from twin.errors import LogError
from twin.recording.formats.array_file import Numbers, Variables, damage, imported, library_errors


def read_ulog(path: Path) -> Variables:
    """The topics of a file; of one that is there several times, the others as `topic_1`.

    Raises:
        LogError: it is no ULog, is damaged, or pyulog is not installed.
    """
    core = imported("pyulog.core", path)
    said = io.StringIO()  # what the library prints of damage is said below
    with (
        library_errors(path, "a PX4 log", "download it again"),
        contextlib.redirect_stdout(said),
        path.open("rb") as content,  # on damage the library does not close what it opened itself
    ):
        log = core.ULog(content)
    arrays: dict[str, Numbers] = {}
    clocks: list[str] = []
    for topic in log.data_list:
        if "timestamp" not in topic.data:
            raise LogError(path, f"has no times of {topic.name}", "download it again")
        name = topic.name if not topic.multi_id else f"{topic.name}_{topic.multi_id}"
        clocks.append(f"{name}.timestamp")
        arrays[clocks[-1]] = np.asarray(topic.data["timestamp"], dtype=np.float64) * 1e-6
        for key, values in topic.data.items():
            if key != "timestamp":
                part = re.sub(r"\[(\d+)\]", lambda result: f".{int(result[1]) + 1}", key)
                arrays[f"{name}.{part}"] = values
    return Variables(arrays, {}, clocks, repairs=damage(path) if log.file_corruption else ())
