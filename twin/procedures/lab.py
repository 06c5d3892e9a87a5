"""Who works with a procedure: what was recorded, what is found in it, what is told of it."""

from dataclasses import dataclass, field

from twin.procedures.fits import Fits
from twin.procedures.logbook import Logbook
from twin.procedures.notes import Notes
from twin.recording import Recording


@dataclass(frozen=True)
class Lab:
    """Of n runs."""

    logbook: Logbook
    """Also an observer of the loop."""
    fits: Fits
    notes: Notes
    logs: dict[int, list[Recording]] = field(default_factory=dict[int, list[Recording]])
    """Of each run: the last swing, and the free float after it once there was one."""
