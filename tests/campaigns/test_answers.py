"""What a campaign says is what was put into it: intervals that hold, causes that are causes."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.campaigns.conftest import GOOD
from twin.campaigns.answers import Answers, answers, conditions
from twin.campaigns.draw import draw
from twin.campaigns.read import read_spec
from twin.campaigns.results import Results, read_results
from twin.campaigns.statistics import bootstrap, holm, mean, quantile, rank_correlation
from twin.errors import CampaignError
from twin.report.campaign_words import comparison_words

ARMS = '[[arms]]\nname = "a"\n\n[[arms]]\nname = "b"\ncontroller = "mass_pid"\n\n[gains]'
OFFSET = "initial.center_of_mass_offset.x"
WIDTH = "effects.stage_backlash.width"


@pytest.fixture(scope="module")
def made_up(tmp_path_factory):
    """Results of 1,200 runs in two arms, whose metrics are laws of the factors and of chance."""

    path = tmp_path_factory.mktemp("made_up") / "spec.toml"

    def results(seed: int = 0) -> Results:
        path.write_text(
            GOOD.replace("[gains]", ARMS).replace("runs = 24", "runs = 1200"), encoding="utf-8"
        )
        spec = read_spec(path)
        drawn, noise = draw(spec, range(1200)), np.random.default_rng(seed)
        arm = np.array([spec.arms[number].name for number in drawn.arms])
        tilt = 1.0 + 2e5 * drawn.values[WIDTH] + 0.3 * noise.normal(size=1200)
        tilt = np.where(arm == "b", 0.8 * tilt, tilt)
        rate = 1e5 * np.abs(drawn.values[OFFSET]) + 0.1 * noise.normal(size=1200)
        travel = noise.normal(size=1200) ** 2
        nothing = np.full(1200, np.nan)
        metrics = {name: nothing.copy() for name in spec.metrics}
        metrics |= {"tilt_rms": tilt, "rate_rms": rate, "stage_travel": travel}
        ended = np.full(1200, "done", dtype="<U6")
        ended[7], reason = "failed", [""] * 1200
        reason[7] = "the body turns at 1.2e+03 rad/s: the run has diverged (at 0.500 s)"
        for values in metrics.values():
            values[7] = np.nan
        values = dict(drawn.values)
        return Results(spec, Path("x"), np.arange(1200), arm, ended, tuple(reason), values, metrics)

    return results


@pytest.fixture(scope="module")
def found(made_up) -> Answers:
    return answers(made_up())


@pytest.mark.parametrize("machines", [8, 60])
def test_the_interval_of_a_mean_holds_the_truth_95_times_in_100(machines):
    draw, held = np.random.default_rng(3), 0
    for _ in range(400):
        one = bootstrap((draw.normal(size=machines),), np.arange(machines), mean)
        held += one.low <= 0.0 <= one.high
    assert stats.binomtest(held, 400, 0.95).pvalue > 1e-3, held


def test_too_few_machines_give_a_mean_no_interval():
    one = bootstrap((np.arange(4.0),), np.arange(4), mean)
    assert one.value == 1.5
    assert np.isnan([one.low, one.high]).all()


@pytest.mark.parametrize("share", [0.5, 0.95])
@pytest.mark.parametrize("machines", [2, 10, 60, 300])
def test_the_interval_of_a_quantile_holds_the_truth_95_times_in_100_of_however_few(machines, share):
    draw, held = np.random.default_rng(3), 0
    for _ in range(400):
        one = quantile(draw.exponential(size=machines), np.arange(machines), share)
        held += one.low <= -np.log(1.0 - share) <= one.high
    assert stats.binomtest(held, 400, 0.95, "less").pvalue > 1e-3, held
    assert machines < 60 or held < 400, "and no wider than it has to be"


def test_ten_machines_say_nothing_from_above_of_the_95th_percentile():
    one = quantile(np.arange(10.0), np.arange(10), 0.95)
    assert one.low == 7.0
    assert one.high == np.inf


def test_runs_of_one_sample_are_not_taken_for_independent():
    draw = np.random.default_rng(4)
    sample = np.repeat(np.arange(100), 8)
    values = draw.normal(size=100)[sample]
    shuffled = draw.permutation(800)
    for interval in (lambda v, s: bootstrap((v,), s, mean), lambda v, s: quantile(v, s, 0.5)):
        alone, together = interval(values, np.arange(800)), interval(values, sample)
        assert (together.high - together.low) > 2.0 * (alone.high - alone.low)
        again = interval(values[shuffled], sample[shuffled])
        assert again.value == pytest.approx(together.value, abs=1e-12)
        uneven = interval(values[:-3], sample[:-3])
        assert uneven.low == pytest.approx(together.low, abs=0.05)


def test_rank_correlation_has_its_interval():
    draw, held = np.random.default_rng(5), 0
    truth = 6.0 / np.pi * np.arcsin(0.5 * 0.6)  # Spearman's of a Gaussian pair with Pearson's 0.6
    for _ in range(200):
        x, noise = draw.normal(size=(2, 100))
        one, p = rank_correlation(x, 0.6 * x + 0.8 * noise)
        held += one.low <= truth <= one.high
        assert p < 0.05
    assert held >= 180
    assert np.isnan(rank_correlation(np.ones(10), np.arange(10.0))[0].value)


def test_corrected_p_values_are_those_of_holm():
    np.testing.assert_allclose(holm(np.array([0.04, 0.01, 0.03])), [0.06, 0.03, 0.06])


def test_a_metric_is_traced_to_the_factors_that_make_it(found):
    sure = {(s.metric, s.factor) for s in found.sensitivities if s.certain}
    assert sure == {("tilt_rms", WIDTH), ("rate_rms", f"|{OFFSET}|")}
    assert all(
        s.correlation.value > 0.5 for s in found.sensitivities if (s.metric, s.factor) in sure
    )


def test_the_worst_runs_are_named_with_what_is_unusual_about_them(found):
    worst = [one for one in found.worst if one.metric == "rate_rms"]
    column = found.results.metrics["rate_rms"]
    assert worst[0].run == int(np.nanargmax(column))
    blamed = worst[0].blamed[0]
    assert blamed.factor == f"|{OFFSET}|"
    assert blamed.value > 1.5e-5
    assert blamed.below > 0.8
    assert blamed.above < 0.2


def test_a_comparison_that_depends_on_a_factor_is_told_part_by_part(made_up):
    results = made_up()
    width = results.factors[WIDTH]
    # from half of the other's to three times it
    share = np.interp(width, [width.min(), width.max()], [0.5, 3.0])
    level = 1.0 + 0.05 * np.random.default_rng(5).normal(size=1200)
    rate = np.where(results.arm == "b", share * level, 1.0)
    parts = conditions(replace(results, metrics={"rate_rms": rate}))
    assert [one.factor for one in parts] == [WIDTH] * 5
    assert [one.pairs for one in parts] == [120] * 5
    assert parts[0].high <= parts[1].low, "each part begins where the one before ends"
    for one in parts:
        middle = np.interp(0.5 * (one.low + one.high), [width.min(), width.max()], [0.5, 3.0])
        assert one.ratio.low < middle + 0.01
        assert one.ratio.high > middle - 0.01
    assert parts[0].ratio.high < 1.0 < parts[1].ratio.low


def test_a_comparison_that_depends_on_nothing_has_no_parts(found):
    assert not found.conditions, "0.8 times as much, whatever the width"


def test_arms_are_compared_on_the_machines_that_both_met(found):
    (tilt,) = (one for one in found.comparisons if one.metric == "tilt_rms")
    assert (tilt.one, tilt.other) == ("a", "b")
    assert tilt.pairs == 599, "one run of a pair has failed"
    assert tilt.ratio.low < 0.8 < tilt.ratio.high
    assert tilt.p < 1e-6
    (travel,) = (one for one in found.comparisons if one.metric == "stage_travel")
    assert travel.p > 0.05
    assert travel.ratio.low < 1.0 < travel.ratio.high


@pytest.mark.parametrize("same", [True, False])
def test_two_campaigns_are_compared_machine_by_machine_where_they_drew_the_same(made_up, same):
    one, other = made_up(0), made_up(1)
    changed = {**other.metrics, "tilt_rms": 1.05 * other.metrics["tilt_rms"]}
    width = other.factors[WIDTH] * (1.0 if same else 1.01)
    factors = {**other.factors, WIDTH: width}
    other = replace(other, metrics=changed, factors=factors, folder=Path("y"))
    found = [c for c in answers(one, other).comparisons if c.one.startswith("x: ")]
    assert {c.metric for c in found} == {"tilt_rms", "rate_rms", "stage_travel"}
    assert {c.pairs > 0 for c in found} == {same}
    tilt = next(c for c in found if c.metric == "tilt_rms")
    assert (tilt.one, tilt.other) == ("x: a", "y: a")
    assert tilt.ratio.low < 1.05 < tilt.ratio.high
    assert (tilt.p < 1e-6) == same, "pairs see what the spread of the machines hides"
    assert all(c.p > 0.05 for c in found if c.metric != "tilt_rms")


def test_what_is_the_same_on_every_machine_is_said_to_be(made_up):
    results = made_up()
    results = replace(results, metrics={"tilt_rms": np.ones(1200)})
    (one,) = answers(results).comparisons
    assert (one.wins, one.ties, one.p) == (0.0, 1.0, 1.0)
    assert "the same with a and b on 300 machines" in comparison_words(one)


def test_runs_that_failed_are_counted_by_reason_and_left_out(found):
    assert found.ended == {"a": {"done": 600}, "b": {"done": 599, "failed": 1}}
    ((reason, count, run),) = found.reasons
    assert (count, run) == (1, 7)
    assert reason == "the body turns at ... rad/s: the run has diverged"
    counts = {s.count for s in found.spreads if s.arm == "b"}
    assert counts == {599}


def test_a_folder_without_a_campaign_is_refused(tmp_path):
    with pytest.raises(CampaignError, match="holds no campaign"):
        read_results(tmp_path)
