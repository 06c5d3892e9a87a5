"""Pages of runs, identifications and balancings begin with the answer; figures are exported."""

import csv
import re
from html import unescape
from pathlib import Path

import pytest

import twin
from twin.cli.main import main
from twin.flight import Run
from twin.identification import Identification

SWING = "multisine:8@0.1"


@pytest.fixture(scope="module")
def run() -> Run:
    return twin.fly("sads", "quaternion_pd", reference=SWING, duration=20.0, seed=1)


@pytest.fixture(scope="module")
def identified(run: Run) -> Identification:
    return twin.identify(run.recording, "sads")


def verdict(page: str) -> str:
    (answer,) = re.findall(r"<p class='verdict'>(.*?)</p>", page)
    return unescape(re.sub("<.*?>", "", answer))


def test_a_runs_page_begins_with_how_it_tracked_and_ends_with_where_it_is_from(run: Run):
    page = run.page()
    assert re.match(r"Done after 20 s: tracking error [\d.]+ deg rms", verdict(page))
    assert page.count("<svg") == 2
    assert "Constant: stage_position" in page
    assert re.search(r"<footer><p>airbearing-twin [\d.]+, \d{4}-\d\d-\d\d</p>", page)
    assert "platform sads: sha256" in page


def test_an_identifications_page_begins_with_the_parameters(identified: Identification):
    answer = verdict(identified.page())
    names = identified.base.names
    assert all(f"{name} = " in answer for name in names)
    assert answer.endswith("with 95 % intervals.")
    assert identified.page().count("<svg") == 2, "parameters and residuals"


def test_a_folder_gets_figures_for_print_and_tables_for_other_programs(
    identified: Identification, tmp_path: Path
):
    folder = identified.save(tmp_path / "figures")
    names = {path.name for path in folder.iterdir()}
    assert {"parameters.svg", "parameters.pdf", "residuals.svg", "parameters.csv"} <= names
    assert (folder / "parameters.pdf").read_bytes().startswith(b"%PDF")
    with (folder / "parameters.csv").open() as file:
        head, *rows = csv.reader(file)
    assert head == ["parameter", "stated", "identified", "change"]
    assert [row[0] for row in rows] == list(identified.base.names)


def test_the_figures_of_a_comparison_are_written_beside_its_page(tmp_path: Path, capsys):
    log, figures = "models/dfki_pendulum/logs/sysid", tmp_path / "deep" / "figures"
    page = tmp_path / "page.html"
    assert main(["compare", log, "--figures", str(figures), "--report", str(page)]) == 0
    assert f"wrote {figures}" in capsys.readouterr().out
    drawn = {path.stem for path in figures.glob("*.svg")}
    assert drawn == {path.stem for path in figures.glob("*.pdf")}
    assert len(drawn) == page.read_text(encoding="utf-8").count("<svg")
    assert {"free_runs", "residuals", "misfit", "symptoms"} <= drawn
    assert {"streams", "laws", "base"} == {path.stem for path in figures.glob("*.csv")}


def test_figures_do_not_go_into_a_file(tmp_path: Path, capsys):
    (tmp_path / "a").write_text("")
    log = "models/dfki_pendulum/logs/sysid"
    assert main(["compare", log, "--figures", str(tmp_path / "a")]) == 2
    assert "is a file; name a folder for the figures" in capsys.readouterr().err


def test_a_page_has_no_path_of_the_computer_that_made_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    log = (Path("models") / "dfki_pendulum" / "logs" / "sysid").resolve()
    monkeypatch.setattr("sys.argv", ["/opt/somewhere/bin/twin", "compare", str(log)])
    page = twin.compare(str(log)).page()
    assert "made by: twin compare sysid" in page
    assert str(log.parent) not in page
    assert "/opt/" not in page


@pytest.mark.slow(20)
def test_a_balancings_page_begins_with_what_gravity_can_still_do():
    page = twin.balance("sads", duration=900.0).page()
    assert re.match(
        r"Balanced after \d+ s: gravity's torque at the worst attitude is [\d.]+ .?N m "
        r"\([\d.]+ to [\d.]+\), within the target of ",
        verdict(page),
    )
    assert "<th>s1</th>" in page


def test_a_balancing_that_is_cut_short_says_so_first():
    page = twin.balance("sads", duration=5.0).page()
    assert verdict(page).startswith("Not balanced within 5 s; it was in phase ")
