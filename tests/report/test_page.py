"""The page stands alone, and its numbers are those of the comparison."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

from twin.comparison import Comparison, compare
from twin.comparison.explanation import Strength
from twin.comparison.symptoms import Symptom, SymptomDomain
from twin.library import library
from twin.platform import platform_of
from twin.recording import open_log
from twin.report import document, sentences, with_prediction, write_page
from twin.report.words import strength_words


@pytest.fixture(scope="module")
def comparison() -> Comparison:
    log = open_log(library("models") / "dfki_pendulum" / "logs" / "sysid")
    return compare(log, platform_of(log))


@pytest.fixture(scope="module")
def text(comparison: Comparison, tmp_path_factory: pytest.TempPathFactory) -> str:
    """The page of that comparison, in a folder that is not there yet."""
    page = tmp_path_factory.mktemp("page") / "deep" / "page.html"
    write_page(page, [comparison], [])
    return page.read_text(encoding="utf-8")


def test_the_page_needs_nothing_but_itself(text: str):
    assert text.count("<svg") == 6
    assert not re.search(r"(src|href)=[\"'](?!#)", text), "it loads something from elsewhere"
    assert len(text) < 2_000_000
    assert "dry friction" in text


def test_the_page_is_the_same_twice(text: str, comparison: Comparison, tmp_path: Path):
    write_page(tmp_path / "again.html", [comparison], [])
    assert (tmp_path / "again.html").read_text(encoding="utf-8") == text


def test_the_document_is_json_and_says_the_same(comparison: Comparison):
    log = json.loads(json.dumps(document([comparison], [])))["logs"][0]
    assert log["sentences"] == sentences(comparison)
    base = log["accounts"]["refitted"]["base"]["inertia"]
    assert base["low"][0][0] is None, "a hinge about y sees no Jxx"
    assert base["low"][1][1] < base["value"][1][1] < base["high"][1][1]
    laws = {law["name"]: law["unit"] for law in log["accounts"]["as_built"]["laws"]}
    assert laws["bearing_coulomb_friction"] == "N m"


def test_prediction_plus_residual_is_the_measurement(comparison: Comparison):
    streams = with_prediction(comparison.best.explained)
    angle = streams["joint_angle"]
    total = streams["predicted_joint_angle"].value + streams["residual_joint_angle"].value
    assert total == pytest.approx(angle.value, abs=1e-12)


def strength(values: list[float], half: list[float], parts: tuple[str, ...] = ()) -> Strength:
    """Of a law with so many components."""
    symptom = Symptom("a", SymptomDomain.torque, "", "{}", "N m", (), parts=parts)
    return Strength(symptom, np.array(values), np.array(half), 0.0, ())


def test_sizes_over_wheels_name_each_wheel_and_those_that_may_be_none():
    wheels = ("for w1", "for w2", "for w3")
    said = strength_words(strength([2e-3, 1e-6, 1e-3], [4e-6, 5e-6, 1e-4], wheels))
    assert said == (
        "2.000 mN m (1.996 to 2.004) for w1 and 1.0 mN m (0.9 to 1.1) for w3 "
        "(of w2 no size is sure)"
    )


def test_a_size_has_the_digits_that_its_interval_asks_for():
    assert strength_words(strength([2e-3], [4e-7])) == "2.0000 mN m (1.9996 to 2.0004)"
    assert strength_words(strength([2e-3], [1e-3])) == "2 mN m (1 to 3)"
