"""The doctor tells what keeps a session from working, what makes it late, and what would do."""

import json
import os
import pty
import sys

import pytest

from twin.cli.main import main

if sys.platform == "win32":
    pytest.skip("it looks at Linux", allow_module_level=True)

from twin.service.doctor import Verdict, check_adapters, check_governor, check_port, judged


def test_a_port_that_is_there_may_be_opened():
    ours, theirs = pty.openpty()
    found = check_port("imu", os.ttyname(theirs))
    os.close(ours)
    os.close(theirs)
    assert found.verdict is Verdict.good
    assert found.what == "port of imu"


def test_a_port_that_is_not_there_or_is_none_is_bad(tmp_path):
    gone = check_port("imu", "/dev/serial/by-id/usb-not_there")
    assert gone.verdict is Verdict.bad
    assert "is not there; plugged in are: " in gone.sentence
    file = tmp_path / "port"
    file.touch()
    assert "is no serial port" in check_port("imu", str(file)).sentence


def test_a_port_on_the_network_is_left_to_status():
    assert check_port("imu", "socket://host:4000").verdict is Verdict.good


def test_an_adapter_that_holds_bytes_back_is_poor_and_the_line_that_mends_it_is_told(tmp_path):
    for name, wait in (("ttyUSB0", 16), ("ttyUSB1", 1)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "latency_timer").write_text(f"{wait}\n")
    slow, quick = check_adapters(tmp_path)
    assert (slow.what, slow.verdict) == ("adapter ttyUSB0", Verdict.poor)
    assert f"echo 1 > {tmp_path}/ttyUSB0/latency_timer" in slow.sentence
    assert quick.verdict is Verdict.good


def test_a_processor_that_saves_power_is_poor(tmp_path):
    file = tmp_path / "governor"
    assert check_governor(file) == []
    file.write_text("powersave\n")
    assert check_governor(file)[0].verdict is Verdict.poor
    file.write_text("performance\n")
    assert check_governor(file)[0].verdict is Verdict.good


def test_lateness_is_judged_by_its_tail_and_by_what_was_missed():
    prompt = [1e-4] * 1000
    assert judged(prompt, 0).verdict is Verdict.good
    assert judged(prompt, 1).verdict is Verdict.poor
    assert judged([*prompt, *[2e-2] * 20], 0).verdict is Verdict.poor


def test_the_verb_ends_with_1_only_where_something_is_bad(capsys):
    assert main(["doctor", "--seconds", "0.2"]) == 0
    assert "lateness: ticks come" in capsys.readouterr().out
    assert main(["doctor", "cubesat", "--seconds", "0.2", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found[0]["what"] == "port of feather"
    assert found[0]["verdict"] == "bad"
    assert main(["doctor", "--rate", "0"]) == 2
