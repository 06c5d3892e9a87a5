"""Files of numbers that a log may be made of: CSV, Parquet, MAT, MCAP."""

from twin.recording.formats.find import ENDINGS as ENDINGS
from twin.recording.formats.find import OpenFiles as OpenFiles
from twin.recording.formats.number_file import NumberFile as NumberFile
