"""A cable hidden in a run is named, sized, written into a platform and worth what it should."""

import json
from collections.abc import Callable
from dataclasses import fields, replace

import numpy as np
import pytest

from twin.cli.main import main
from twin.diagnosis import Experiment, diagnose, extend, extension, validate
from twin.diagnosis.diagnosis import crowded
from twin.diagnosis.engine import Engine
from twin.diagnosis.explanation import Explanation
from twin.effects import effect_named, effects_of
from twin.errors import UsageError
from twin.platform import load_platform
from twin.recording import Recording, open_log
from twin.report import diagnosed, diagnosis_document, validated, write_diagnosis

STIFFNESS = 0.05
FEW = ("harness_stiffness", "bearing_viscous_friction")
"""Causes, the true one among them, where it does not matter what else is asked for."""


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs")
    fly = ["run", "sads", "--controller", "quaternion_pd", "--duration", "40"]
    hidden = ["--effects", f"harness_stiffness={STIFFNESS}"]
    for name, seed in (("first.rrd", "1"), ("second.rrd", "2")):
        assert main([*fly, *hidden, "--seed", seed, "--rrd", str(folder / name)]) == 0
    return folder


@pytest.fixture(scope="module")
def found(logs):
    return diagnose([open_log(logs / "first.rrd")], load_platform("sads"))


def test_the_cause_is_named_and_sized(found):
    assert [cause.effect.name for cause in found.causes] == ["harness_stiffness"]
    (cause,) = found.causes
    assert abs(cause.effect.values[0] - STIFFNESS) < 1.5 * cause.half_widths[0]
    assert cause.evidence > 500.0
    assert found.residual_test.chance > 1e-4


def test_a_cause_that_nothing_else_looks_like_explains_the_log(found):
    assert found.verdict == "explained"
    assert found.causes[0].confidence > 0.99


def test_the_gain_is_measured_on_time_that_was_not_fitted(found):
    gain = found.held_out
    assert gain.log_likelihood > 200.0
    assert gain.low < gain.after < gain.high + 0.02 < gain.before


def test_a_cause_that_foretells_nothing_explains_nothing(found):
    worse = replace(found, held_out=replace(found.held_out, log_likelihood=-1.0))
    assert worse.verdict == "unexplained"
    assert "does not improve the prediction" in diagnosed(worse)[0]


def test_causes_of_more_kinds_than_are_likely_at_once_explain_nothing(found):
    names = ("bearing_swirl_torque", "gyro_bias", "gyro_drift", "residual_dipole")
    many = tuple(effect_named(name).typical("") for name in names)
    assert not crowded(many[:3])
    assert crowded(many)
    crowd = replace(found, explained=replace(found.explained, effects=many))
    assert crowd.verdict == "unexplained"


def test_a_fit_that_has_lost_the_motion_names_nothing(found, monkeypatch):
    instead = Explanation.instead

    def lost(*args):
        there = instead(*args)
        parts = {one.name: getattr(there, one.name) for one in fields(Explanation)}
        return Lost(**parts)

    monkeypatch.setattr(Explanation, "instead", lost)
    asked = [one for one in found.asked if one.label in FEW]
    assert len(asked) == len(FEW)
    line = Engine(asked, lambda _: None).explained(found.baseline)
    assert line.explanation.effects == ()
    assert line.residual_test.chance < 1e-4 or line.explanation.noise.wanders


class Lost(Explanation):
    """A fit that ended in another motion than the log's."""

    cost = 1e12


def test_what_was_not_asked_is_said_with_its_reason_but_for_parts_that_the_machine_lacks(found):
    said = "\n".join(diagnosed(found))
    assert "stage_backlash:s1" in said.split("not observable: what it acts on does not move")[0]
    assert "residual_dipole: not possible here: its environment has no magnetic field" in said
    assert "the platform has no" not in said


def test_the_document_keeps_its_contract(found):
    document = json.loads(json.dumps(diagnosis_document(found, None), default=float))
    assert document["verdict"] in ("healthy", "explained", "ambiguous", "unexplained")
    (cause,) = document["causes"]
    assert cause["name"] == "harness_stiffness"
    stiffness = cause["parameters"]["stiffness"]
    assert stiffness["low"] < stiffness["value"] < stiffness["high"]
    assert stiffness["unit"] == "N m/rad"
    assert 0.0 < cause["confidence"] <= 1.0
    assert np.shape(document["base"]["inertia"]["value"]) == (3, 3)
    held_out = document["gain"]["held_out"]
    assert set(held_out["chi2_per_sample"]) == {"before", "after", "band"}
    assert set(held_out["free_run"]["10"]) == {"before", "after", "perfect"}
    assert document["equation"] is None
    assert document["next_experiment"] is None


def test_the_extended_platform_flies_with_the_cause_in_it(found, tmp_path, capsys):
    platform = extend(found, tmp_path / "extended")
    (effect,) = effects_of(platform)
    assert effect.values[0] == pytest.approx(found.causes[0].effect.values[0], rel=1e-6)
    assert platform.inertia == pytest.approx(load_platform("sads").inertia, abs=0.2)
    assert "harness_stiffness: stiffness" in (tmp_path / "extended" / "README.md").read_text()
    assert main(["check", str(tmp_path / "extended")]) == 0
    fly = ["run", str(tmp_path / "extended"), "--controller", "quaternion_pd", "--duration", "1"]
    assert main(fly) == 0
    assert "harness_stiffness" in capsys.readouterr().err


def test_an_extension_overwrites_nothing(found, tmp_path):
    (tmp_path / "mine.txt").write_text("precious")
    with pytest.raises(UsageError, match="not empty"):
        extend(found, tmp_path)


def test_an_extension_that_cannot_be_finished_leaves_nothing(found, tmp_path, monkeypatch):
    def refuse(*_: object) -> None:
        raise UsageError("no")

    monkeypatch.setattr(extension, "give_joints", refuse)
    with pytest.raises(UsageError, match="no"):
        extend(found, tmp_path / "extended")
    assert not (tmp_path / "extended").exists()


@pytest.fixture(scope="module")
def validated_gain(found, logs):
    """What the second log says of the first's causes."""
    return validate(found, open_log(logs / "second.rrd"))


def test_another_log_gains_too(validated_gain):
    gain = validated_gain
    assert gain.log_likelihood > 200.0
    assert gain.after < gain.before


def test_a_log_that_was_misread_is_validated_as_it_should_be_read_and_that_is_said(
    found, logs, validated_gain
):
    log = open_log(logs / "second.rrd")
    gyro = replace(log["gyro"], value=log["gyro"].value * [1.0, 1.0, -1.0])
    misread = replace(log, streams={**log.streams, "gyro": gyro})
    gain, right = validate(found, misread), validated_gain
    assert gain.log_likelihood == pytest.approx(right.log_likelihood, rel=1e-6)
    assert "Gyro's z axis points the other way" in validated(gain)
    assert right.conventions == ()


def test_of_a_validating_log_with_a_pause_the_longest_part_is_looked_at(found, logs):
    log = open_log(logs / "second.rrd")
    parts = {
        name: replace(series, time=np.where(series.time > 12.0, series.time + 3600.0, series.time))
        for name, series in log.streams.items()
    }
    gain = validate(found, replace(log, streams=parts))
    assert gain.log_likelihood > 100.0
    assert any("the longest is looked at" in repair for repair in gain.repairs)


def test_the_page_says_what_the_terminal_says(found, tmp_path):
    path = tmp_path / "page.html"
    write_diagnosis(path, found, None)
    page = path.read_text(encoding="utf-8")
    assert "harness_stiffness" in page
    assert page.count("<svg") == 4, "prediction, residual, before and after, causes"
    assert "src=" not in page, "it stands alone"
    assert diagnosed(found)[0].split(":")[0] in ("Explained", "Ambiguous")


def test_the_page_shows_the_experiment_that_would_split_a_tie(found, tmp_path):
    line = "twin run sads --controller quaternion_pd --duration 40"
    best = Experiment(
        line, 40.0, ("harness_stiffness",), {"clock_lag:gyro": 41.0}, {"clock_lag:gyro": 3.0}
    )
    tied = replace(found, next_experiment=best)
    write_diagnosis(tmp_path / "page.html", tied, None)
    page = (tmp_path / "page.html").read_text()
    assert line in page
    assert "41.0" in page
    assert any(line in said for said in diagnosed(tied))


@pytest.mark.slow(80)
def test_a_cause_is_named_where_only_laws_without_a_name_show_the_motion_that_it_makes(
    flight_of: Callable[..., Recording],
):
    # swirled so far from the model's own motion that no cause's column fits there
    hidden = "bearing_swirl_torque=0.010556834097888665"
    log = flight_of("sads", "quaternion_pd", "multisine:8", 40.0, 631380575, hidden)
    found = diagnose([log], load_platform("sads"))
    assert [cause.effect.label for cause in found.causes] == ["bearing_swirl_torque"]
    assert found.verdict == "explained"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("seed", "stiffness"),
    [(1023646586, 0.5911112), (1270939648, 0.6504693), (14, 0.7323933)],
    ids=["columns along a lost motion", "another one beside it", "a base that is no machine's"],
)
def test_a_cable_is_named_alone_where_the_model_without_it_loses_the_motion(
    flight_of: Callable[..., Recording], seed: int, stiffness: float
):
    hidden = f"harness_stiffness={stiffness}"
    log = flight_of("sads", "quaternion_pd", "multisine:8", 40.0, seed, hidden)
    found = diagnose([log], load_platform("sads"))
    assert [cause.effect.label for cause in found.causes] == ["harness_stiffness"]
    assert found.verdict == "explained"
