"""Names in an `.rrd`, and the version of their arrangement."""

SCHEMA = 1
"""Version; a reader refuses a newer one. It counts up when an old reader would misread."""

APPLICATION = "airbearing-twin"
TIMELINE = "time"

PROVENANCE = "provenance"
"""Entity that holds the facts about the recording, as JSON text."""
ENDING = "provenance/end"
"""Entity that says how the recording ended, if not well, as JSON text; written last."""

STREAM = "stream"
COLUMNS = "columns"
UNIT = "unit"
"""Header of a stream's entity: its name, its columns' names, their unit."""

TIME = "host_time"
"""Exact times of a stream's rows [s], each the eight bytes of a little-endian float64."""
VALUE = "Scalars:scalars"
"""Rerun's own component of plotted numbers."""
TEXT = "TextDocument:text"
"""Rerun's own component of a text."""
