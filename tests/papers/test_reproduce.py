"""Rows judged by criteria that were fixed first; parts that may fail; pages that last."""

import json
from collections import Counter
from pathlib import Path

import pytest

from papers.page import write_html, write_markdown
from papers.rows import Agreement, Ours, Paper, PaperPart, Row, judge, paper_named, read_papers
from papers.run import UNCOMPUTED, Reproduced, parts_of, reproduce
from tests.papers import parts as some
from twin.cli.main import main
from twin.errors import FileError, UnknownName

PAPERS = read_papers()


def row(kind, bound, published: float | str = 2.0, otherwise="", name="000.a"):
    return Row(name, "an item", published, kind, bound, otherwise)


@pytest.mark.parametrize(
    ("kind", "bound", "inside", "outside"),
    [
        ("within", 0.1, (1.81, 2.19), (1.79, 2.21)),
        ("below", 1.0, (0.99, -5.0), (1.0, 2.0)),
        ("above", 1.0, (1.01, 9.0), (1.0, -2.0)),
        ("between", (1.0, 3.0), (1.0, 3.0), (0.99, 3.01)),
        ("holds", True, (True,), (False,)),
        ("holds", False, (False,), (True,)),
    ],
)
def test_a_row_agrees_inside_its_criterion_and_differs_outside(kind, bound, inside, outside):
    one = row(kind, bound)
    assert all(judge(one, Ours(value)).status is Agreement.agrees for value in inside)
    assert all(judge(one, Ours(value)).status is Agreement.differs for value in outside)


def test_a_published_value_is_covered_where_our_interval_holds_it():
    covers = row("covers", True)
    assert judge(covers, Ours(1.5, 1.0, 2.1)).status is Agreement.agrees
    assert judge(covers, Ours(1.5, 1.0, 1.9)).status is Agreement.differs
    several = row("covers", True, published="all of them")
    assert judge(several, Ours(True)).status is Agreement.agrees


def test_what_was_said_beforehand_explains_a_difference_and_nothing_else_does():
    one = row("below", 1.0, otherwise="It was known.")
    assert judge(one, Ours(0.5)).status is Agreement.agrees
    differs = judge(one, Ours(2.0, note="By a run."))
    assert differs.status is Agreement.differs_explained
    assert differs.note == "It was known. By a run."


@pytest.mark.parametrize("value", [float("nan"), float("inf"), float("-inf")])
@pytest.mark.parametrize(("kind", "bound"), [("below", 1.0), ("above", 1.0), ("within", 0.5)])
def test_a_number_that_is_not_finite_agrees_with_nothing(kind, bound, value):
    assert judge(row(kind, bound), Ours(value)).status is Agreement.differs


@pytest.mark.parametrize(
    ("one", "ours"),
    [
        (row("below", 1.0), Ours(True)),
        (row("holds", True), Ours(1.0)),
        (row("covers", True), Ours(2.0)),
        (row("within", 0.1, published="much"), Ours(2.0)),
    ],
)
def test_an_answer_of_another_kind_than_the_question_is_refused(one, ours):
    with pytest.raises(ValueError, match="000.a"):
        judge(one, ours)


def test_sixty_seven_rows_each_with_a_name_of_its_own():
    names = [one.id for paper in PAPERS for one in paper.rows]
    assert len(names) == 67
    assert len(set(names)) == 67


@pytest.mark.parametrize("paper", PAPERS, ids=lambda paper: paper.number)
def test_every_row_is_computed_by_one_part_and_every_part_computes_rows_of_its_paper(paper):
    parts = parts_of(paper.number)
    if not parts:
        pytest.skip(f"{paper.number} has no parts yet")
    count = Counter(name for part in parts for name in part.ids)
    assert count == {one.id: 1 for one in paper.rows}


def test_a_paper_that_is_not_there_is_refused_by_name(capsys):
    with pytest.raises(UnknownName, match="no paper named '007'"):
        paper_named(PAPERS, "007")
    assert main(["reproduce", "007"]) == 2
    assert "no paper named '007'" in capsys.readouterr().err


def test_fewer_than_one_job_is_refused(capsys):
    assert main(["reproduce", "000", "--jobs", "0"]) == 2
    assert "--jobs is 0" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("line", "sentence"),
    [
        ("below = 1.0\nabove = 0.0", "has 2 criteria"),
        ("", "has 0 criteria"),
        ("between = [1.0]", "give 2 numbers"),
        ("holds = 1", "give true or false"),
        ("below = 1.0\nbeyond = 2.0", "no key we know"),
    ],
)
def test_a_row_that_says_no_clear_criterion_is_refused_with_its_line(tmp_path, line, sentence):
    path = tmp_path / "rows.toml"
    head = '[paper.000]\nplatform = "tas2"\n[[row]]\nid = "000.a"\nitem = "it"\npublished = 1.0\n'
    path.write_text(head + line)
    with pytest.raises(FileError, match=sentence):
        read_papers(path)


def test_the_same_row_twice_or_of_no_paper_is_refused(tmp_path):
    path = tmp_path / "rows.toml"
    one = '[[row]]\nid = "000.a"\nitem = "it"\npublished = 1.0\nbelow = 1.0\n'
    path.write_text('[paper.000]\nplatform = "tas2"\n' + one + one)
    with pytest.raises(FileError, match="a second time"):
        read_papers(path)
    path.write_text('[paper.001]\nplatform = "tas2"\n' + one)
    with pytest.raises(FileError, match="begin it with the number"):
        read_papers(path)


FOUR = Paper(
    "000",
    "tas2",
    ("A title",),
    tuple(row("below", 1.0, name=f"000.{name}") for name in ("good", "raises", "dies", "missing")),
)
PARTS = (
    PaperPart(("000.raises",), some.raises),
    PaperPart(("000.good",), some.good),
    PaperPart(("000.dies",), some.dies),
)


@pytest.fixture(scope="module")
def four():
    """Three parts, of which two fail, and a row that none computes."""
    said: list[str] = []
    return reproduce(FOUR, PARTS, jobs=2, say=said.append), said


def test_a_part_that_fails_costs_its_rows_and_no_other(four):
    found, _ = four
    good, raises, dies, missing = found.rows
    assert good.status is Agreement.agrees
    assert good.ours == Ours(0.5, note="Half of one.")
    assert all(one.status is Agreement.differs for one in (raises, dies, missing))
    assert "ZeroDivisionError" in raises.note
    assert "ended with code 3" in dies.note
    assert missing.note == UNCOMPUTED
    assert len(found.failures) == 2


def test_who_waits_is_told_what_is_being_done(four):
    _, said = four
    assert "000.good: counting" in said
    assert any(line.startswith("3 of 3: ") for line in said)


def test_what_a_part_draws_reaches_the_page(four, tmp_path):
    found, _ = four
    write_html(tmp_path / "page.html", [found], ["000"])
    page = (tmp_path / "page.html").read_text()
    assert "<figcaption>A line</figcaption>" in page
    assert "<svg" in page
    assert not any(word in page for word in ("<script", "<link", "<img", "@import"))


def other(number: str, value: float):
    below = row("below", 1.0, name=f"{number}.a")
    paper = Paper(number, "tas2", (f"Paper {number}",), (below,))
    return Reproduced(paper, (judge(below, Ours(value)),), {}, ())


@pytest.mark.parametrize("write", [write_markdown, write_html])
def test_one_paper_alone_leaves_the_others_rows_in_the_page_as_they_were(tmp_path: Path, write):
    path, order = tmp_path / "folder" / "page", ["000", "001", "002"]
    write(path, [other("002", 0.125), other("000", 0.25)], order)
    before = path.read_text()
    write(path, [other("001", 0.375)], order)
    both = path.read_text()
    assert [both.index(value) for value in ("0.25", "0.375", "0.125")] == sorted(
        both.index(value) for value in ("0.25", "0.375", "0.125")
    )
    write(path, [other("000", 0.75)], order)
    assert "0.25" not in path.read_text()
    write(path, [other("000", 0.25)], order)
    assert path.read_text() == both
    assert len(both) > len(before)


def test_json_is_one_list_of_rows_with_what_the_contract_names(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("papers.run.parts_of", lambda number: ())
    words = ["reproduce", "003", "--json", "--table", str(tmp_path / "a.md")]
    assert main([*words, "--report", str(tmp_path / "a.html")]) == 0
    rows = json.loads(capsys.readouterr().out)
    assert [one["id"] for one in rows] == [one.id for one in paper_named(PAPERS, "003").rows]
    for one in rows:
        assert {"id", "paper", "item", "published", "ours", "criterion", "status"} <= set(one)
        assert one["status"] in {"agrees", "differs_explained", "differs"}
        assert one["ours"] is None
    assert "not computed" in (tmp_path / "a.md").read_text()
