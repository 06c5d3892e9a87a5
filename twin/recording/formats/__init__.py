"""Files of numbers that a log may be made of: text, Parquet, arrays, messages."""

from twin.recording.formats.array_file import NumberFile as NumberFile
from twin.recording.formats.array_file import Say as Say
from twin.recording.formats.array_file import silent as silent
from twin.recording.formats.dataflash_file import is_dataflash as is_dataflash
from twin.recording.formats.find import ARRAYS as ARRAYS
from twin.recording.formats.find import ENDINGS as ENDINGS
from twin.recording.formats.find import TEXTS as TEXTS
from twin.recording.formats.find import TOPICS as TOPICS
from twin.recording.formats.find import OpenFiles as OpenFiles
