"""`twin report`: the page of a campaign stands alone, and its table says the same as its JSON."""

import json
import re
from pathlib import Path

import pytest

import twin
from twin.campaigns.execute import execute
from twin.campaigns.folder import Folder
from twin.campaigns.read import read_spec
from twin.cli.main import main

SPEC = """
platform = "cubesat"
estimator = "passthrough"
controller = "mass_magnetic_pid"
runs = 24
duration = 1.0
seed = 3
metrics = ["tilt_rms", "gravity_torque", "stage_travel"]

[gains]
derivative = { grid = [1e-3, 2e-3] }

[initial]
hangs = true
center_of_mass_offset = { uniform = [[-2e-5, -2e-5, -1.4e-4], [2e-5, 2e-5, -1e-4]] }

[[arms]]
name = "mixed"

[[arms]]
name = "masses <only>"
controller = "mass_pid"
"""


@pytest.fixture(scope="module")
def flown(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("campaign")
    (folder / "spec.toml").write_text(SPEC, encoding="utf-8")
    spec = read_spec(folder / "spec.toml")
    execute(spec, Folder(folder / "out"), workers=1, tell=lambda said: None)
    return folder / "out"


def test_a_report_is_a_page_that_stands_alone(flown, capsys):
    assert main(["report", str(flown)]) == 0
    said = capsys.readouterr().out
    assert "24 of 24 runs of cubesat flown" in said
    page = (flown / "report.html").read_text(encoding="utf-8")
    assert not re.search(r"(src|href)=['\"]?(http|/)", page)
    assert page.count("<svg") >= 4, "distributions, dependence, and the grid of each metric"
    assert "masses &lt;only&gt;" in page
    assert "masses <only>" not in page.split("<pre>")[0]
    assert "twin replay" in page


def test_the_tables_as_markdown_say_the_same_as_the_document(flown, capsys, tmp_path):
    page = tmp_path / "page.html"
    assert main(["report", str(flown), "--json", "--html", str(page)]) == 0
    document = json.loads(capsys.readouterr().out)
    table = page.with_suffix(".md").read_text(encoding="utf-8")
    assert document["runs"] == document["of"] == 24
    assert {one["metric"] for one in document["metrics"]} == {
        "tilt_rms",
        "gravity_torque",
        "stage_travel",
    }
    for one in document["comparisons"]:
        assert f"| {one['metric']} | masses &lt;only> / mixed | 12 |" in table
    bars = [len(re.findall(r"(?<!\\)\|", row)) for row in table.splitlines() if row[:1] == "|"]
    assert set(bars) == {5, 6, 7, 8}, "a size is written with bars, which must not end a cell"
    for one in document["worst"]:
        arm = one["arm"].replace("<", "&lt;")
        assert f"| {one['metric']} | {one['run']} | {arm} |" in table
    assert "<" not in table, "names in it would be HTML where a browser shows it"


def test_two_campaigns_are_held_against_each_other(flown, capsys):
    assert main(["report", str(flown), "--against", str(flown), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["comparisons"]
    own = [c for c in found if c["one"].startswith("out: ")]
    assert len(own) == 6
    assert all(c["ratio_of_means"]["value"] == 1.0 and c["same_in"] == 1.0 for c in own)
    assert main(["report", str(flown), "--against", str(flown)]) == 0
    assert "the same machines, duration and seed." in capsys.readouterr().out


def test_a_campaign_of_another_kind_is_held_against_with_what_differs(flown, capsys, tmp_path):
    text = 'platform = "dfki_pendulum"\ncontroller = "free_float"\nruns = 2\nduration = 0.1\n'
    (tmp_path / "spec.toml").write_text(text + "seed = 5\n")
    assert main(["campaign", str(tmp_path / "spec.toml"), str(tmp_path / "other")]) == 0
    assert main(["report", str(flown), "--against", str(tmp_path / "other")]) == 0
    said = capsys.readouterr().out
    assert "they differ in machines (cubesat, cubesat here, dfki_pendulum there), duration" in said
    assert "They have no metric in common." in said


def test_each_point_of_the_grid_has_its_row(flown, capsys):
    assert main(["report", str(flown), "--json"]) == 0
    points = json.loads(capsys.readouterr().out)["points"]
    assert len(points) == 2 * 2 * 3, "arms, gains, metrics"
    assert {one["count"] for one in points} == {6}
    assert {one["at"]["gains.derivative"] for one in points} == {1e-3, 2e-3}
    assert "## Over the grid" in (flown / "report.md").read_text()


def test_a_campaigns_page_begins_with_which_arm_is_better_and_by_how_much(flown):
    text = re.sub("<.*?>", "", twin.results(flown).page().split("<p class='verdict'>")[1])
    first, *_ = text.split("\n")
    assert re.search(
        r"(is better than .*: [\d.]+ \([\d.]+ to [\d.]+\) times the .*, on \d+ machines"
        r"|No difference in .* is proven on \d+ machines \(ratio [\d.]+ \([\d.]+ to [\d.]+\)\))",
        first,
    )


def test_a_metric_that_is_the_same_in_every_run_has_a_sentence_and_no_distribution(tmp_path):
    (tmp_path / "spec.toml").write_text(
        'platform = "sads"\ncontroller = "quaternion_pd"\nruns = 8\nduration = 0.5\nseed = 1\n'
        'metrics = ["stage_travel", "tracking_error_rms"]\n[effects.gyro_bias]\n'
    )
    answers = twin.campaign(tmp_path / "spec.toml", tmp_path / "out")
    assert "The same in every run: path of all masses together 0 um" in str(answers)
    head, *rows = (answers.save(tmp_path / "f") / "distributions.csv").read_text().splitlines()
    assert head.startswith("metric,arm,runs")
    assert [row.split(" ")[0] for row in rows] == ["tracking_error_rms"]


def test_figures_of_a_campaign_are_written_on_request(flown, tmp_path, capsys):
    assert main(["report", str(flown), "--figures", str(tmp_path / "f")]) == 0
    assert {"distributions.svg", "over_the_grid.pdf", "comparisons.csv", "grid.csv"} <= {
        path.name for path in (tmp_path / "f").iterdir()
    }
    assert f"figures: {tmp_path / 'f'}" in capsys.readouterr().out
