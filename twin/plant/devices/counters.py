"""What went over a line or a network."""

from dataclasses import dataclass


@dataclass(slots=True)
class Counters:
    """What went over the line. Only the session's thread writes here; anybody may look."""

    frames: int = 0
    """Whole messages that passed their check."""
    bad_checksums: int = 0
    gaps: int = 0
    """Messages that the device's own counter says were sent and that never came."""
    resyncs: int = 0
    """Times that bytes were skipped to find the next message."""
    timeouts: int = 0
    """Answers, or messages of a stream, that did not come in time."""
    strangers: int = 0
    """Packets of a network that came from another address, or without the key."""
    repeats: int = 0
    """Packets that came twice, late or out of order."""
    overflows: int = 0
    """Samples thrown away, the oldest first, because nobody fetched them."""

    def words(self) -> str:
        """How many messages, and what was wrong."""
        wrong = {
            "wrong checksums": self.bad_checksums,
            "gaps": self.gaps,
            "resynchronisations": self.resyncs,
            "silences": self.timeouts,
            "packets of strangers": self.strangers,
            "packets repeated or out of order": self.repeats,
            "samples nobody fetched": self.overflows,
        }
        bad = ", ".join(f"{count} {what}" for what, count in wrong.items() if count)
        return f"{self.frames} frames, {bad or 'none wrong'}"
