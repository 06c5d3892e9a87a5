"""Other programs' files in, a log of ours out: each stream, unit, clock and frame with its reason.

`tables_in` lists the tables of a file; `streams_among` recognises streams among their columns by
name and by content; `import_files` writes log.toml, holds what it then reads against physics
(`conventions/`), and mends what is sure.
"""

from twin.intake.importing import import_files as import_files
