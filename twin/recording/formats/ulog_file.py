"""A PX4 log (`.ulg`) with pyulog: fields by topic, as `sensor_combined.gyro_rad.1`."""

import contextlib
import io
import re
from pathlib import Path

import numpy as np

from twin.errors import LogError
from twin.recording.formats.array_file import Numbers, Variables
from twin.recording.formats.extras import imported


def read_ulog(path: Path) -> Variables:
    """The topics of a file; of one that is there several times, the others as `topic_1`.

    Raises:
        LogError: it is no ULog, is damaged, or pyulog is not installed.
    """
    core = imported("pyulog.core", path)
    said = io.StringIO()  # what the library prints of damage is said below
    try:
        with contextlib.redirect_stdout(said):
            log = core.ULog(str(path))
    except Exception as problem:  # on damaged bytes the reader raises what its parts raise
        text = str(problem).split("\n", 1)[0] or type(problem).__name__
        raise LogError(path, f"cannot be read as a PX4 log ({text})", "download it again") from None
    arrays: dict[str, Numbers] = {}
    clocks: list[str] = []
    for topic in log.data_list:
        name = topic.name if not topic.multi_id else f"{topic.name}_{topic.multi_id}"
        clocks.append(f"{name}.timestamp")
        arrays[clocks[-1]] = np.asarray(topic.data["timestamp"], dtype=np.float64) * 1e-6
        for key, values in topic.data.items():
            if key != "timestamp":
                part = re.sub(r"\[(\d+)\]", lambda found: f".{int(found[1]) + 1}", key)
                arrays[f"{name}.{part}"] = values
    return Variables(arrays, {}, clocks)
