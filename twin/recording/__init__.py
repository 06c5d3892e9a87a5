"""Runs and logs: in memory, as `.rrd`, and as folders of tables."""

from twin.recording.folder import write_folder as write_folder
from twin.recording.log import open_log as open_log
from twin.recording.log import read_log as read_log
from twin.recording.pauses import restricted as restricted
from twin.recording.read import read_recording as read_recording
from twin.recording.recording import Recording as Recording
from twin.recording.recording import Series as Series
