"""Rows of docs/reproduction.toml: the published value, ours, and whether the two agree.

Each row's criterion was fixed before its value was computed.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Any

from twin.config import Table, read_toml
from twin.errors import UnknownName

CRITERIA = Path(__file__).parents[1] / "docs" / "reproduction.toml"

KINDS = ("within", "below", "above", "between", "holds", "covers")
"""Of criteria; a row has one."""


@dataclass(frozen=True)
class Row:
    """A table or a figure of a paper, and when ours agrees with it."""

    id: str
    """`000.fig7.sphere`; what stands before the first point is the paper's number."""
    item: str
    published: float | str
    kind: str
    """Of the criterion, one of `KINDS`."""
    bound: float | bool | tuple[float, float]
    """The number of `within`, `below` and `above`, both of `between`, else whether it must."""
    otherwise: str = ""
    """Why it may differ, said beforehand; empty where nothing was said."""
    assumed: str = ""
    """What the paper does not print and had to be chosen."""

    @property
    def paper(self) -> str:
        """Its number."""
        return self.id.partition(".")[0]

    @property
    def criterion(self) -> str:
        """In words."""
        if isinstance(self.bound, bool):
            return "the statement holds" if self.kind == "holds" else "within our 95 % interval"
        if isinstance(self.bound, tuple):
            return f"between {self.bound[0]:g} and {self.bound[1]:g}"
        if self.kind == "within":
            return f"within {100.0 * self.bound:g} %"
        return f"{self.kind} {self.bound:g}"


@dataclass(frozen=True)
class Paper:
    """One that is reproduced."""

    number: str
    platform: str
    """The machine that is its own."""
    facts: tuple[str, ...] = field(default=())
    """Title, authors, or what it is about and where from."""
    rows: tuple[Row, ...] = ()


def read_papers(path: Path | None = None) -> tuple[Paper, ...]:
    """The papers with their rows, in the file's order.

    Args:
        path: of the file; the shipped one unless given.

    Raises:
        FileError: it does not say what it should.
    """
    whole = read_toml(path or CRITERIA)
    rows = [_row(table) for table in whole.tables("row")]
    tables = whole.table("paper")
    papers = tuple(_paper(number, tables.table(number), rows) for number in tables.keys)
    known = set[str]()
    for table, row in zip(whole.tables("row"), rows, strict=True):
        if row.id in known:
            raise table.fail("id", f"is {row.id!r} a second time", "rename one of the two")
        if row.paper not in tables:
            raise table.fail("id", f"is {row.id!r}", "begin it with the number of a [paper]")
        known.add(row.id)
    whole.close()
    return papers


def paper_named(papers: tuple[Paper, ...], number: str) -> Paper:
    """The one with that number.

    Raises:
        UnknownName: there is none.
    """
    for paper in papers:
        if paper.number == number:
            return paper
    raise UnknownName("paper", number, [paper.number for paper in papers])


def _paper(number: str, table: Table, rows: list[Row]) -> Paper:
    facts = [table.text(key, "") for key in ("title", "about", "authors", "from")]
    paper = Paper(
        number,
        table.text("platform"),
        tuple(filter(None, facts)),
        tuple(row for row in rows if row.paper == number),
    )
    table.close()
    return paper


def _row(table: Table) -> Row:
    kinds = [kind for kind in KINDS if kind in table]
    if len(kinds) != 1:
        raise table.fail(
            "id", f"has {len(kinds)} criteria", f"give one of {', '.join(map(repr, KINDS))}"
        )
    (kind,) = kinds
    row = Row(
        table.text("id"),
        table.text("item"),
        _published(table),
        kind,
        _bound(table, kind),
        table.text("otherwise", ""),
        table.text("assumed", ""),
    )
    table.close()
    return row


def _published(table: Table) -> float | str:
    if isinstance(table.raw("published"), str):
        return table.text("published")
    return table.number("published")


def _bound(table: Table, kind: str) -> float | bool | tuple[float, float]:
    if kind == "between":
        low, high = table.numbers(kind, 2)
        return float(low), float(high)
    if kind in ("holds", "covers"):
        value = table.raw(kind)
        if not isinstance(value, bool):
            raise table.fail(kind, f"is {value!r}", "give true or false")
        return value
    return table.number(kind)


Say = Callable[[str], None]
"""Told what is being done."""


@dataclass(frozen=True)
class Ours:
    """What came out for a row of docs/reproduction.toml."""

    value: float | bool
    low: float | None = None
    """Of the 95 % interval, where there is one."""
    high: float | None = None
    note: str = ""
    """How it was computed, or why it is so; a sentence."""


@dataclass(frozen=True)
class Computed:
    """Everything that one part computes."""

    rows: Mapping[str, Ours]
    """By the row's id."""
    figures: Mapping[str, str] = field(default_factory=dict[str, str])
    """Caption -> SVG text, drawn in the paper's axes."""


@dataclass(frozen=True)
class PaperPart:
    """Computes some rows of a paper, as they belong together; alone in a process of its own."""

    ids: tuple[str, ...]
    compute: Callable[[Say], Computed]


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
