"""`twin compare` from the command line."""

import json
from pathlib import Path

import pytest

from twin.cli.main import main
from twin.library import library

SYSID = str(library("models") / "dfki_pendulum" / "logs" / "sysid")


def test_compare_prints_sentences_and_writes_the_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
):
    page = tmp_path / "page.html"
    assert main(["compare", SYSID, "--report", str(page)]) == 0
    out = capsys.readouterr().out
    assert "dry friction" in out
    assert f"wrote {page}" in out
    assert page.stat().st_size > 10_000


def test_compare_json_is_one_document(capsys: pytest.CaptureFixture[str]):
    assert main(["compare", SYSID, "--as-built", "--json"]) == 0
    log = json.loads(capsys.readouterr().out)["logs"][0]
    assert log["accounts"]["refitted"] is None


def test_a_log_that_is_not_there_is_a_sentence(capsys: pytest.CaptureFixture[str]):
    assert main(["compare", "/nowhere/at/all"]) == 1
    assert capsys.readouterr().err == (
        "twin: /nowhere/at/all: there is no such log; "
        "name an .rrd, or a folder that holds a log.toml\n"
    )


def test_no_log_is_wrong_use(capsys: pytest.CaptureFixture[str]):
    assert main(["compare"]) == 2
    assert "LOG" in capsys.readouterr().err.upper()
