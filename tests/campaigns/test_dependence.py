"""Machines are counted and not runs: what does nothing is found as often as its level says."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.campaigns.conftest import GOOD
from twin.campaigns import statistics
from twin.campaigns.answers import conditions, dependences
from twin.campaigns.draw import draw
from twin.campaigns.read import read_spec
from twin.campaigns.results import Results
from twin.campaigns.statistics import between_arms, between_campaigns

GAIN, OTHER, WIDTH = "gains.derivative", "gains.proportional", "effects.stage_backlash.width"
ARMS = '[[arms]]\nname = "a"\n\n[[arms]]\nname = "b"\ncontroller = "mass_pid"\n\n[gains]'
CAMPAIGNS = 300

Array = np.ndarray


@pytest.fixture
def campaign(tmp_path: Path) -> Callable[..., Results]:
    """Runs of 20 machines without metrics: at each of 10 gains unless told otherwise."""

    def made(
        points: int = 10, *, machines: int = 20, arms: int = 1, second: int = 1, text: str = GOOD
    ) -> Results:
        text = text.replace("grid = [1e-3, 2e-3]", f"grid = {_grid(points)}")
        if second > 1:
            text = text.replace("[gains]", f"[gains]\nproportional = {{ grid = {_grid(second)} }}")
        if arms > 1:
            text = text.replace("[gains]", ARMS)
        runs = points * second * machines * arms
        path = tmp_path / "spec.toml"
        path.write_text(text.replace("runs = 24", f"runs = {runs}"), encoding="utf-8")
        spec = read_spec(path)
        drawn = draw(spec, range(runs))
        arm = np.array([spec.arms[number].name for number in drawn.arms])
        ended, reason = np.full(runs, "done"), ("",) * runs
        values = dict(drawn.values)
        return Results(spec, tmp_path, np.arange(runs), arm, ended, reason, values, {})

    return made


@pytest.fixture
def few_resamples(monkeypatch):
    """Of intervals that nobody looks at."""
    monkeypatch.setattr(statistics, "RESAMPLES", 10)


def _grid(points: int) -> str:
    return str(np.linspace(1e-3, 2e-3, points).round(6).tolist())


def _even(results: Results, factor: str) -> Array:
    """A factor's values (n,), of mean 0 and standard deviation 1."""
    return stats.zscore(results.factors[factor])


class Chance:
    """What differs from campaign to campaign beside its factors, from one seed."""

    def __init__(self, results: Results, seed: int = 0) -> None:
        self._draw, self._results = np.random.default_rng(seed), results

    def machines(self) -> Array:
        """(n,) a number of each machine, which its runs share."""
        machine = self._results.machine
        return self._draw.normal(size=machine.max() + 1)[machine]

    def runs(self) -> Array:
        """(n,) a number of each run."""
        return self._draw.normal(size=len(self._results.run))


def p_of(results: Results, factor: str, values: Array) -> float:
    """Of the rows whose value is finite."""
    rows = np.flatnonzero(np.isfinite(values))
    return next(p for name, _, p in dependences(results, rows, values[rows]) if name == factor)


def found_at_5_percent(p_values: list[float]) -> int:
    assert len(p_values) == CAMPAIGNS
    return int(np.sum(np.array(p_values) < 0.05))


def assert_as_chance_has_it(p_values: list[float]) -> None:
    found = found_at_5_percent(p_values)
    assert stats.binomtest(found, CAMPAIGNS, 0.05).pvalue > 0.01, (
        f"{found} of {CAMPAIGNS} found what is not there; a third or more: runs are counted"
    )


@pytest.mark.usefixtures("few_resamples")
def test_a_drawn_factor_that_does_nothing_is_no_more_certain_for_a_grid(campaign):
    results = campaign()
    chance, gain = Chance(results), _even(results, GAIN)
    assert_as_chance_has_it(
        [
            p_of(results, WIDTH, chance.machines() + gain + 0.5 * chance.runs())
            for _ in range(CAMPAIGNS)
        ]
    )


@pytest.mark.usefixtures("few_resamples")
def test_a_drawn_factor_that_does_something_is_found_with_a_grid(campaign):
    results = campaign()
    chance, gain, width = Chance(results), _even(results, GAIN), _even(results, WIDTH)
    p_values = [
        p_of(results, WIDTH, width + chance.machines() + gain + 0.5 * chance.runs())
        for _ in range(CAMPAIGNS)
    ]
    assert found_at_5_percent(p_values) > 0.9 * CAMPAIGNS


@pytest.mark.usefixtures("few_resamples")
@pytest.mark.parametrize("points", [2, 10])
def test_a_factor_on_the_grid_that_does_nothing_is_found_as_chance_has_it(campaign, points):
    results = campaign(points)
    chance, gain = Chance(results), _even(results, GAIN)
    nothing = [
        p_of(results, GAIN, chance.machines() + 0.5 * chance.runs()) for _ in range(CAMPAIGNS)
    ]
    assert_as_chance_has_it(nothing)
    either = [
        p_of(results, GAIN, chance.machines() * gain + 0.5 * chance.runs())
        for _ in range(CAMPAIGNS)
    ]
    assert_as_chance_has_it(either)  # up on one machine and down on another


@pytest.mark.usefixtures("few_resamples")
@pytest.mark.parametrize("points", [2, 10])
def test_a_factor_on_the_grid_is_found_under_what_machines_differ_by(campaign, points):
    results = campaign(points)
    chance, gain = Chance(results), _even(results, GAIN)
    values = [0.3 * gain + chance.machines() + 0.5 * chance.runs() for _ in range(CAMPAIGNS)]
    found = found_at_5_percent([p_of(results, GAIN, one) for one in values])
    assert found > 0.9 * CAMPAIGNS
    pooled = [float(stats.spearmanr(gain, one).pvalue) for one in values]
    if points == 2:
        assert found > 2 * found_at_5_percent(pooled), "the machines hide it"


def test_a_second_grid_does_not_hide_the_first(campaign):
    results = campaign(3, second=4)
    gain, other = _even(results, GAIN), _even(results, OTHER)
    rows = np.arange(len(results.run))
    found = {name: one for name, one, _ in dependences(results, rows, 0.01 * gain + other)}
    assert found[GAIN].value == pytest.approx(1.0)
    assert found[OTHER].value == pytest.approx(1.0)
    assert np.isnan(found[WIDTH].value), "it is the same on every machine"


def test_machines_that_fail_where_all_are_bad_do_not_look_better(campaign):
    results = campaign()
    chance, gain, width = Chance(results), _even(results, GAIN), _even(results, WIDTH)
    failed = (width > 0.0) & (gain > 0.5)
    values = np.where(failed, np.nan, chance.machines() + 10.0 * gain + chance.runs())
    machines = results.machine
    plain = [np.nanmean(values[machines == one]) for one in range(20)]
    drawn = [width[machines == one][0] for one in range(20)]
    assert stats.spearmanr(plain, drawn).pvalue < 1e-3
    assert p_of(results, WIDTH, values) > 0.05


def test_a_gain_that_changes_nothing_on_most_machines_goes_with_little(campaign):
    results = campaign(2)
    rows = np.arange(len(results.run))
    values = np.where(results.machine < 3, _even(results, GAIN), 1.0 / 3.0)
    found = {name: (one, p) for name, one, p in dependences(results, rows, values)}
    one, p = found[GAIN]
    assert one.value == pytest.approx(3 / 20)
    assert p > 0.05, "three machines of twenty"


def test_without_a_grid_each_run_is_a_machine_of_its_own(campaign):
    text = GOOD.replace("grid = [1e-3, 2e-3]", "uniform = [1e-3, 2e-3]")
    results = campaign(1, machines=60, text=text)
    values = np.random.default_rng(2).normal(size=60).round(1) + _even(results, WIDTH)
    for name, one, p in dependences(results, np.arange(60), values):
        theirs = stats.spearmanr(results.causes[name], values)
        assert (one.value, p) == (theirs.statistic, theirs.pvalue)


def test_where_nothing_is_drawn_each_run_stands_for_itself(campaign):
    text = GOOD[: GOOD.index("center_of_mass_offset")].replace('"sobol"', '"grid"')
    results = campaign(25, machines=1, text=text)
    assert not results.spec.dispersed
    values = np.random.default_rng(2).normal(size=25) + _even(results, GAIN)
    ((name, one, p),) = dependences(results, np.arange(25), values)
    theirs = stats.spearmanr(results.factors[GAIN], values)
    assert (name, one.value, p) == (GAIN, theirs.statistic, theirs.pvalue)


@pytest.mark.usefixtures("few_resamples")
def test_arms_are_compared_on_machines_and_not_on_each_of_their_runs(campaign):
    results = campaign(arms=2)
    chance, second = Chance(results), results.arm == "b"

    def told(difference: float) -> float:
        rate = 5.0 + chance.machines() + second * (difference + 0.5 * chance.machines())
        (one,) = between_arms(replace(results, metrics={"rate_rms": rate + 0.2 * chance.runs()}))
        assert (one.pairs, one.machines) == (200, 20)
        return one.p

    assert_as_chance_has_it([told(0.0) for _ in range(CAMPAIGNS)])
    assert found_at_5_percent([told(0.5) for _ in range(CAMPAIGNS)]) > 0.9 * CAMPAIGNS


@pytest.mark.usefixtures("few_resamples")
def test_campaigns_are_compared_on_machines_and_not_on_each_of_their_runs(campaign):
    results = campaign()
    chance = Chance(results)

    def told(difference: float) -> float:
        one, other = (
            replace(results, metrics={"rate_rms": 5.0 + chance.machines() + 0.5 * chance.runs()})
            for _ in range(2)
        )
        other.metrics["rate_rms"] += difference
        (compared,) = between_campaigns(one, other)
        return compared.p

    assert_as_chance_has_it([told(0.0) for _ in range(CAMPAIGNS)])
    assert found_at_5_percent([told(1.5) for _ in range(CAMPAIGNS)]) > 0.9 * CAMPAIGNS


@pytest.mark.parametrize(("factor", "machines"), [(WIDTH, 33), (GAIN, 20)])
def test_a_ratio_is_told_by_parts_of_as_many_machines(campaign, factor, machines):
    results = campaign(5, machines=machines, arms=2)
    share = np.exp(_even(results, factor))
    rate = np.where(results.arm == "b", share, 1.0)
    parts = conditions(replace(results, metrics={"rate_rms": rate}))
    assert {one.factor for one in parts} == {factor}
    assert sum(one.pairs for one in parts) == 5 * machines
    assert all(one.pairs % 5 == 0 for one in parts), "a machine's runs stay in one part"
    assert all(one.high < other.low for one, other in zip(parts, parts[1:], strict=False))
