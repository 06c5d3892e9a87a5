"""What a planned experiment detects and confuses agrees with linear algebra and with diagnoses."""

import json

import numpy as np
import pytest

from twin import TwinError
from twin.cli.main import main
from twin.diagnosis.screen import TIED
from twin.experiments.isolation import Isolation, isolate

DURATION = 20.0


@pytest.fixture(scope="module")
def isolation() -> Isolation:
    return isolate("dfki_pendulum", duration=DURATION)


def named(result: Isolation, label: str):
    return next(cause for cause in result.causes if cause.label == label)


def test_a_pendulum_detects_friction_and_confuses_its_laws(isolation: Isolation):
    friction = named(isolation, "bearing_viscous_friction")
    assert 0.0 < friction.size[0] < 1e-3
    assert "aerodynamic_drag" in friction.ties
    assert friction.separable > friction.detectable


def test_a_tie_is_a_rival_whose_evidence_is_behind_by_less_than_the_limit(isolation: Isolation):
    labels = [cause.label for cause in isolation.causes]
    for row, cause in enumerate(isolation.causes):
        near = {
            label
            for label, behind in zip(labels, isolation.behind[row], strict=True)
            if behind < TIED and label != cause.label
        }
        assert near == {tie for tie in cause.ties if tie in labels}


def test_more_evidence_asks_for_a_larger_size():
    """Gain goes with the square of a size: four times the evidence, about twice the size."""
    small = isolate("dfki_pendulum", duration=DURATION, evidence=60.0, advise=False)
    large = isolate("dfki_pendulum", duration=DURATION, evidence=240.0, advise=False)
    for cause in small.causes:
        other = named(large, cause.label)
        if np.isfinite(other.detectable):
            assert 1.7 < other.detectable / cause.detectable < 2.1, cause.label


def test_a_sensor_fewer_detects_no_smaller_size(isolation: Isolation):
    fewer = isolate("dfki_pendulum", duration=DURATION, sensors=["joint_angle"], advise=False)
    for cause in fewer.causes:
        assert cause.detectable >= 0.98 * named(isolation, cause.label).detectable
    assert any(item.words == "without joint_rate" for item in isolation.alternatives)


def test_the_machine_s_own_stop_bounds_the_motion_that_is_planned():
    result = isolate("whorl1", duration=10.0, advise=False)
    assert result.run.reference == "multisine:2.5"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"sensors": ["joint_rats"]}, "did you mean 'joint_rate'"),
        ({"duration": 0.0}, "duration is 0 s"),
        ({"evidence": -1.0}, "evidence is -1"),
        ({"reference": "multisine:5"}, "no shipped law makes dfki_pendulum follow a reference"),
    ],
)
def test_a_mistake_is_told_with_what_would_do(words, sentence):
    with pytest.raises(TwinError, match=sentence):
        isolate("dfki_pendulum", **{"duration": DURATION, "advise": False, **words})


def test_the_verb_prints_a_table_a_document_and_a_page(tmp_path, capsys):
    page = tmp_path / "page.html"
    words = ["isolate", "dfki_pendulum", "--brief", "--duration", "20"]
    assert main([*words, "--html", str(page)]) == 0
    printed = capsys.readouterr().out
    assert "bearing_viscous_friction" in printed
    assert "confused at the detectable size" in printed
    assert "Which causes it confuses" in page.read_text(encoding="utf-8")
    assert main([*words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert len(document["behind"]["evidence"]) == len(document["causes"])
