"""What a procedure tells of each run: its phases as they begin, and how it ended."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

from twin.procedures.phases import OVER, WORDS, Phase
from twin.procedures.statement import Statement


class Remark(NamedTuple):
    """What is said of a run."""

    run: int
    time: float
    """[s]."""
    words: str


@dataclass
class RunNotes:
    """Of one run."""

    phase: Phase = Phase.lower
    since: float = 0.0
    """[s]."""
    identified: int = 0
    """How many times its offset was."""
    said: list[Remark] = field(default_factory=list[Remark])
    """In the order of time."""
    reason: str = ""
    """Why it was stopped; empty unless it was."""
    statement: Statement | None = None
    """Of the machine as it stands: once it is balanced, or stopped where it was judged."""


class Notes:
    """Notes of n runs; each remark is handed on as it is made."""

    def __init__(self, n: int, tell: Callable[[Remark], None] | None = None) -> None:
        self.runs = [RunNotes() for _ in range(n)]
        self._tell = tell

    def begin(self, run: int, phase: Phase, time: float) -> None:
        """A phase begins."""
        notes = self.runs[run]
        notes.phase, notes.since = phase, time
        if phase not in OVER:
            # the masses move on, and what was said of where they stood is true no more
            notes.statement = None
        self.say(run, time, f"{phase.name}: {WORDS[phase]}")

    def say(self, run: int, time: float, words: str) -> None:
        """One remark."""
        remark = Remark(run, time, words)
        self.runs[run].said.append(remark)
        if self._tell is not None:
            self._tell(remark)

    def stop(self, run: int, time: float, reason: str) -> None:
        """It cannot go on."""
        self.runs[run].reason = reason
        self.runs[run].phase, self.runs[run].since = Phase.stopped, time
        self.say(run, time, f"stopped: {reason}")

    @property
    def over(self) -> bool:
        """Whether no run goes on."""
        return all(run.phase in OVER for run in self.runs)
