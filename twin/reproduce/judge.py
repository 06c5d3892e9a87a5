"""Whether ours agrees with what was published, by the criterion that was fixed beforehand."""

import math
from dataclasses import dataclass
from enum import Enum
from typing import Any

from twin.reproduce.part import Ours
from twin.reproduce.rows import Row


class Agreement(Enum):
    """The value is the word of `--json`."""

    agrees = "agrees"
    differs_explained = "differs_explained"
    """As the row said beforehand that it may."""
    differs = "differs"


_WORDS = {
    Agreement.agrees: "agrees",
    Agreement.differs_explained: "differs, explained",
    Agreement.differs: "differs",
}


@dataclass(frozen=True)
class Judged:
    """A row with what came out for it."""

    row: Row
    ours: Ours | None
    """None where nothing came out."""
    status: Agreement
    note: str
    """How it was computed, why it differs, or why nothing came out."""

    @property
    def verdict(self) -> str:
        """The status in words; a row that nothing came out for differs from nothing."""
        return "not computed" if self.ours is None else _WORDS[self.status]

    def document(self) -> dict[str, Any]:
        """For `--json`."""
        ours = self.ours
        return {
            "id": self.row.id,
            "paper": self.row.paper,
            "item": self.row.item,
            "published": self.row.published,
            "ours": None if ours is None else ours.value,
            "low": None if ours is None else ours.low,
            "high": None if ours is None else ours.high,
            "criterion": self.row.criterion,
            "status": self.status.value,
            "note": self.note,
        }


def judge(row: Row, ours: Ours) -> Judged:
    """By the row's criterion; what lies outside is explained only where the row said why."""
    if agrees(row, ours):
        return Judged(row, ours, Agreement.agrees, ours.note)
    status = Agreement.differs_explained if row.otherwise else Agreement.differs
    return Judged(row, ours, status, " ".join(filter(None, (row.otherwise, ours.note))))


def nothing(row: Row, why: str) -> Judged:
    """A row without a value is not said to agree, nor does what was said beforehand explain it."""
    return Judged(row, None, Agreement.differs, why)


def agrees(row: Row, ours: Ours) -> bool:
    """Whether the criterion is met. A number that is not finite meets none.

    Raises:
        ValueError: ours is a number where the criterion asks for a statement, or the other way.
    """
    value = ours.value
    if row.kind == "holds" or (row.kind == "covers" and isinstance(row.published, str)):
        if not isinstance(value, bool):
            raise ValueError(f"{row.id} asks whether it is so; a part gave {value!r}")
        return value is row.bound
    if isinstance(value, bool):
        raise ValueError(f"{row.id} asks for a number; a part gave {value!r}")
    if not math.isfinite(value):
        return False
    if isinstance(row.bound, bool):
        return _covers(row, ours) is row.bound
    if isinstance(row.bound, tuple):
        return row.bound[0] <= value <= row.bound[1]
    if row.kind == "within":
        return abs(value - _number(row)) <= row.bound * abs(_number(row))
    return value < row.bound if row.kind == "below" else value > row.bound


def _covers(row: Row, ours: Ours) -> bool:
    if ours.low is None or ours.high is None:
        raise ValueError(f"{row.id} asks for an interval; a part gave none")
    return ours.low <= _number(row) <= ours.high


def _number(row: Row) -> float:
    if isinstance(row.published, str):
        raise ValueError(f"{row.id} compares with {row.published!r}, which is no number")
    return row.published
