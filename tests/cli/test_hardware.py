"""`twin hardware`, as its user meets it."""

import json
import sys

import pytest

from twin.cli.main import main

PRACTICE = ["--plant", "pty", "--lockstep"]


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_status_is_told_in_laboratory_units_and_as_one_document(capsys):
    assert main(["hardware", "cubesat", "status", *PRACTICE]) == 0
    told = capsys.readouterr().out
    assert "feather (emulated feather) at" in told
    assert "uT" in told
    assert "no signal says whether it floats" in told
    assert main(["hardware", "cubesat", "status", *PRACTICE, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["would_be_armed"] is True
    assert document["devices"][0]["name"] == "feather"
    assert document["floating"] is None


@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_jog_tells_what_it_did(capsys):
    words = ["jog", "s1", "-1.0", "--floating", "--json"]
    assert main(["hardware", "cubesat", *words, *PRACTICE]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["action"] == "jog"
    assert "turned the right way" in document["told"][1]
    assert document["stage_position"][0] == pytest.approx(-1e-3, abs=1.2e-5)


def test_a_machine_that_is_not_there_is_told_without_a_traceback(capsys):
    assert main(["hardware", "cubesat", "status"]) == 1
    assert "feather: cannot open /dev/serial/by-id/" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "sentence"),
    [
        (["home"], 1, "home refused: a mass that runs over its travel throws a floating table"),
        (["zero", "--floating"], 1, "zero refused"),
        (["park"], 1, "say --captured"),
        (["spin-down"], 1, "momentum would go into a floating table"),
        (["jog", "s1", "0.5"], 1, "it is not stated whether the table floats"),
        (["jog", "s1"], 2, "give jog STAGE MM"),
        (["jog", "s9", "0.5", "--floating"], 2, "no stage named 's9'"),
        (["zero", "s1", "--captured"], 2, "zero takes no stage"),
        (["status", "--floating", "--captured"], 2, "it is one or the other"),
        (["status", "--plant", "sim"], 2, "no plant named 'sim'"),
        (["status", "--lockstep"], 2, "--lockstep is for plant pty"),
        (["dance"], 2, "dance"),
    ],
)
def test_what_is_refused_is_told_in_a_sentence(words, code, sentence, capsys):
    assert main(["hardware", "cubesat", *words]) == code
    told = capsys.readouterr()
    assert sentence in told.err
    assert told.out == ""


def test_a_platform_without_hardware_says_what_to_write(capsys):
    assert main(["hardware", "sads", "status", "--plant", "pty"]) == 1
    assert "no [hardware]" in capsys.readouterr().err
