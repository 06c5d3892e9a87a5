"""Sobol indices are those of closed forms, and are asked for in a way that can give them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from tests.campaigns.conftest import GOOD
from twin.campaigns.answers import answers, indices_of, sobol_indices
from twin.campaigns.distribution import shares
from twin.campaigns.draw import draw
from twin.campaigns.read import read_spec
from twin.campaigns.results import Results
from twin.errors import CampaignError
from twin.report.campaign_words import campaign_document, markdown

NAMES = ("x1", "x2", "x3")
A, B = 7.0, 0.1
POINTS = 1024

DESIGN = GOOD.replace('"sobol"', '"saltelli"').replace(
    "grid = [1e-3, 2e-3]", "uniform = [1e-3, 2e-3]"
)
"""Of nine factors: eleven runs a point."""
OFFSET, WIDTH = "initial.center_of_mass_offset.x", "effects.stage_backlash.width"


def ishigami(x):
    return np.sin(x[..., 0]) + A * np.sin(x[..., 1]) ** 2 + B * x[..., 2] ** 4 * np.sin(x[..., 0])


def closed_form() -> tuple[list[float], list[float]]:
    """First-order and total indices of Ishigami's function over [-pi, pi]^3.

    Source: T. Ishigami, T. Homma, An importance quantification technique in uncertainty analysis
    for computer models, ISUMA 1990; the variances are its integrals.
    """
    one = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
    two = A**2 / 8.0
    both = B**2 * np.pi**8 * (1.0 / 18.0 - 1.0 / 50.0)
    whole = one + two + both
    first = [one / whole, two / whole, 0.0]
    total = [(one + both) / whole, two / whole, both / whole]
    return first, total


@pytest.fixture(scope="module")
def values():
    table = shares("saltelli", range(5 * POINTS), 5 * POINTS, NAMES, 3)
    return ishigami(np.pi * (2.0 * table - 1.0)).reshape(POINTS, 5)


@pytest.mark.parametrize("factor", range(3))
def test_indices_of_ishigamis_function_are_its_closed_form(values, factor):
    first, total = indices_of(values, factor)
    truth = [side[factor] for side in closed_form()]
    for found, true in zip((first, total), truth, strict=True):
        assert found.value == pytest.approx(true, abs=0.02)
        assert found.low <= true <= found.high
        assert found.high - found.low < 0.3


def test_indices_are_scipys(values):
    one, other, mixed = values[:, 0], values[:, 1], values[:, 2:].T
    given = {"f_A": one[None], "f_B": other[None], "f_AB": mixed[:, None]}
    theirs = stats.sobol_indices(func=given, n=POINTS)
    for factor in range(3):
        first, total = indices_of(values, factor)
        assert first.value == pytest.approx(theirs.first_order[factor], abs=1e-12)
        assert total.value == pytest.approx(theirs.total_order[factor], abs=1e-12)


def test_a_design_is_two_halves_and_their_mixtures():
    table = shares("saltelli", range(40), 40, NAMES, 3).reshape(8, 5, 3)
    for one, other, *mixed in table:
        for factor, row in enumerate(mixed):
            assert row[factor] == other[factor]
            kept = np.arange(3) != factor
            assert np.array_equal(row[kept], one[kept])
        assert not np.isin(one, other).any()
    for few in ([0], [39], [3, 4, 17, 18]):
        assert np.array_equal(shares("saltelli", few, 40, NAMES, 3), table.reshape(40, 3)[few])


@pytest.fixture
def made_up(tmp_path: Path) -> Results:
    """64 points of a design, whose metrics are laws of two factors."""
    path = tmp_path / "spec.toml"
    runs = 64 * 11
    path.write_text(DESIGN.replace("runs = 24", f"runs = {runs}"), encoding="utf-8")
    spec = read_spec(path)
    assert spec.together == 11
    drawn = draw(spec, range(runs))
    offset, width = (
        drawn.values[name] / np.abs(drawn.values[name]).max() for name in (OFFSET, WIDTH)
    )
    metrics = {name: np.full(runs, np.nan) for name in spec.metrics}
    metrics["tilt_rms"] = 3.0 + offset
    metrics["rate_rms"] = offset * (width - width.mean())
    metrics["rate_rms"][5] = np.nan
    arm = np.full(runs, spec.arms[0].name)
    ended = np.full(runs, "done")
    return Results(
        spec, tmp_path, np.arange(runs), arm, ended, ("",) * runs, dict(drawn.values), metrics
    )


def test_a_campaign_says_what_each_metric_depends_on_and_with_what(made_up):
    found = {(one.metric, one.factor): one for one in sobol_indices(made_up)}
    alone = found["tilt_rms", OFFSET]
    assert alone.first.value == pytest.approx(1.0, abs=0.1)
    assert alone.total.value == pytest.approx(1.0, abs=0.1)
    assert found["tilt_rms", WIDTH].total.value == pytest.approx(0.0, abs=1e-12)
    for factor in (OFFSET, WIDTH):
        product = found["rate_rms", factor]
        assert product.first.low < 0.1 < 0.6 < product.total.value
        assert product.count == 63, "the point of a run that failed is left out whole"


def test_the_report_has_them_and_they_are_no_chance_of_runs_that_share_a_point(made_up):
    whole = answers(made_up)
    assert "Sobol indices" in markdown(whole)
    (one,) = [
        one
        for one in campaign_document(whole)["sobol_indices"]
        if (one["metric"], one["factor"]) == ("tilt_rms", OFFSET)
    ]
    assert one["total"]["low"] < 1.0 < one["total"]["high"]
    certain = {(s.metric, s.factor.strip("|")) for s in whole.sensitivities if s.certain}
    assert ("tilt_rms", OFFSET) in certain
    assert ("tilt_rms", WIDTH) not in certain
    assert np.count_nonzero(made_up.free) == 128
    other = replace(made_up, spec=replace(made_up.spec, sampling="random"))
    assert sobol_indices(other) == ()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("runs = 24", "runs = 24", "is 24; a Saltelli design of 9 factors has 11 runs for each"),
        ("runs = 24", "runs = 60", "give 44; 256 points, 2816 runs"),
        ("uniform = [1e-3, 2e-3]", "grid = [1e-3, 2e-3]", "gains.derivative is on a grid"),
    ],
)
def test_what_is_no_design_is_told(spec_of, old, new, told):
    with pytest.raises(CampaignError, match=told):
        spec_of((old, new), text=DESIGN)
