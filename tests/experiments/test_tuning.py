"""Tuned gains are better on runs that took no part, or it is said that they are not."""

from dataclasses import replace

import pytest

from twin import TwinError, tune
from twin.cli.main import main
from twin.experiments.tuning import Tuning
from twin.interval import Interval

FAST = {"runs": 4, "held_out": 8, "evaluations": 10, "duration": 10.0}


@pytest.fixture(scope="module")
def tuning() -> Tuning:
    return tune("quaternion_pd", "sads", **FAST)


def test_gains_that_are_too_soft_are_raised_and_judged_better_on_other_runs(tuning: Tuning):
    assert tuning.better
    assert tuning.after < tuning.before
    assert tuning.tuned["proportional"] > tuning.usual["proportional"]


def test_the_difference_is_that_of_the_same_runs(tuning: Tuning):
    assert tuning.difference.value == pytest.approx(tuning.after - tuning.before)
    assert tuning.lost == (0, 0)


def test_the_first_set_is_the_law_s_own_and_the_search_is_repeatable(tuning: Tuning):
    assert tuning.trials[0].gains == tuning.usual
    again = tune("quaternion_pd", "sads", **FAST)
    assert [t.merit for t in again.trials] == [t.merit for t in tuning.trials]


def test_an_interval_that_holds_0_proposes_nothing(tuning: Tuning):
    even = replace(tuning, difference=Interval(-1e-4, -3e-4, 1e-4))
    assert not even.better
    assert "keep the gains as they are" in str(even)
    failing = replace(tuning, lost=(0, 1))
    assert not failing.better


def test_a_campaign_s_file_gives_the_dispersions(tmp_path, capsys):
    spec = tmp_path / "spec.toml"
    spec.write_text(
        'platform = "sads"\ncontroller = "quaternion_pd"\nruns = 64\nduration = 5.0\nseed = 4\n'
        "[initial]\nattitude = { normal = [0.0, 0.02] }\n[effects.gyro_bias]\n"
    )
    page = tmp_path / "page.html"
    words = ["tune", "quaternion_pd", "--on", "sads", "--spec", str(spec), "--html", str(page)]
    numbers = ["--runs", "4", "--held-out", "8", "--evaluations", "8", "--gains", "derivative"]
    assert main([*words, *numbers]) == 0
    printed = capsys.readouterr().out
    assert "On 8 held-out runs" in printed
    assert "proportional" not in printed
    assert page.read_text(encoding="utf-8").count("<svg") == 1


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"gains": ["derivativ"]}, "did you mean 'derivative'"),
        ({"merit": "tracking"}, "no metric named 'tracking'"),
        ({"merit": "joint_rate_rms"}, "is no metric of these runs"),
        ({"merit": "identified"}, "neither better nor worse"),
        ({"evaluations": 2}, "evaluations is 2"),
    ],
)
def test_a_mistake_is_told_with_what_would_do(words, sentence):
    with pytest.raises(TwinError, match=sentence):
        tune("quaternion_pd", "sads", **{**FAST, **words})


def test_a_law_without_gains_is_refused():
    with pytest.raises(TwinError, match="has no gain to tune"):
        tune("free_float", "sads", **FAST)
