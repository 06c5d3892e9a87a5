"""docs/reproduction.toml: what the papers published, and when ours agrees, fixed beforehand."""

from dataclasses import dataclass, field
from pathlib import Path

from twin.config import Table, read_toml
from twin.errors import UnknownName
from twin.library import reproduction_file

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
    whole = read_toml(path or reproduction_file())
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
