"""The command line: one file and one dataclass per verb, over the same calls as the library."""
