"""A wrong convention is called by its name, and a right log is left in peace."""

import importlib.util
import secrets
import sys
from pathlib import Path

import numpy as np
import pytest

from twin.conventions import check_conventions
from twin.platform import Platform, load_platform

_SPEC = importlib.util.spec_from_file_location("flights", Path(__file__).with_name("flights.py"))
flights = importlib.util.module_from_spec(_SPEC)
sys.modules["flights"] = flights
_SPEC.loader.exec_module(flights)


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture(scope="module")
def right_logs(sads):
    """One log of each grade in each motion."""
    seed = secrets.randbits(32)
    print("seed", seed)
    draw = np.random.default_rng(seed)
    return draw, [
        log
        for grade in flights.GRADES
        for motion in ("multisine", "slow", "unstable")
        for log in flights.flights(sads, draw, grade, motion, 1)
    ]


def test_a_right_log_has_no_finding(sads, right_logs):
    _, logs = right_logs
    assert [str(finding) for log in logs for finding in check_conventions(log, sads)] == []


@pytest.mark.parametrize("kind", ["unit", "order", "direction", "flipped", "swapped", "time_unit"])
def test_a_wrong_convention_is_named(sads, right_logs, kind):
    draw, logs = right_logs
    mistake = flights.make_mistake(logs[3], draw, kind)
    sentences = [finding.sentence for finding in check_conventions(mistake.recording, sads)]
    assert any(mistake.name in sentence for sentence in sentences), (mistake.stream, sentences)
