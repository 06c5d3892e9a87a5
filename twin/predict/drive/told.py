"""Commands: nothing before the first, each holds until the next, the last to the end."""

from dataclasses import replace

import numpy as np

from twin.platform import begins_late
from twin.recording import Recording, Series


def as_told(recording: Recording, stream: str) -> Series:
    """A command from the motion's start to the log's end, where it has few rows or late ones."""
    series = recording[stream]
    late = begins_late(recording, stream)
    if late:
        none = np.zeros((1, series.value.shape[1]))
        time = np.r_[series.time[0] - late, series.time]
        series = replace(series, time=time, value=np.concatenate([none, series.value]))
    if len(series) and series.time[-1] < recording.stop and (late or len(series) == 1):
        time = np.r_[series.time, recording.stop]
        value = np.concatenate([series.value, series.value[-1:]])
        series = replace(series, time=time, value=value)
    return series
