"""Runs and logs: in memory, as `.rrd`, and as folders of tables."""

from twin.recording.recording import Recording as Recording
from twin.recording.recording import Series as Series
