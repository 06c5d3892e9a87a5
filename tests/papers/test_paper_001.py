"""Paper 001: what its parts compute, by independent means; and that they answer every row."""

import dataclasses
import tomllib
from pathlib import Path

import numpy as np
import pytest

from papers import paper_001
from papers.paper_001 import (
    PARTS,
    PRINTED,
    STABLE,
    VERTICAL_START,
    astros,
    at_center,
    flown,
    hanging,
    machine,
    missed,
    offset_bound,
    roots,
    routh,
    swing,
)
from twin.estimators import OffsetFilter
from twin.model import compile_model

ROWS = {
    row["id"]
    for row in tomllib.loads(Path("docs/reproduction.toml").read_text(encoding="utf-8"))["row"]
    if row["id"].startswith("001.")
}


def part_of(name):
    return next(part for part in PARTS if name in part.ids)


def test_every_row_of_the_paper_has_one_part():
    answered = [name for part in PARTS for name in part.ids]
    assert sorted(answered) == sorted(ROWS)


def test_a_part_answers_its_rows_and_draws_its_figure():
    found = part_of("001.reach").compute(lambda doing: None)
    assert found.rows["001.reach"].value is False
    assert set(found.rows) == set(part_of("001.reach").ids)


def test_roots_leave_the_left_half_where_routh_says():
    platform = astros()
    bound = routh(platform, PRINTED)
    # each axis alone: the product of inertia between them moves the edge by a few percent
    for factor, stable in ((0.9, True), (1.1, False)):
        tried = {**PRINTED, "integral": factor * float(bound.min())}
        assert (roots(platform, tried).real.max() < 0.0) == stable
    assert roots(platform, PRINTED).real.max() > 0.0
    assert roots(platform, {**PRINTED, **STABLE}).real.max() < 0.0


def test_masses_on_lines_through_the_centre_give_no_torque_but_that_of_a_changing_inertia():
    platform, draw = astros(), np.random.default_rng(2)
    sizes = np.array([0.02, 1e-2, 1e-2, 0.05])[:, None, None]
    rate, place, speed, pull = sizes * draw.normal(size=(4, 20, 3))
    masses = np.array([stage.mass for stage in platform.stages])
    change = 2.0 * masses * place * speed
    growing = change.sum(axis=1, keepdims=True) - change
    wanted = -np.linalg.solve(platform.inertia, (growing * rate).T).T
    result = missed(platform.inertia, at_center(platform), rate, place, speed, pull)
    np.testing.assert_allclose(result, wanted, rtol=1e-10, atol=1e-18)


def test_what_is_missed_by_mounted_masses_is_the_change_of_their_momentum():
    platform, draw = astros(), np.random.default_rng(3)
    riding = compile_model(platform).sliding
    rate, pull = draw.normal(size=(2, 3)) * [[0.02], [0.05]]
    start, speed, step = np.array([1e-3, -2e-3, 3e-3]), np.array([5e-3, 4e-3, -6e-3]), 1e-4

    def momentum(time):
        """Of the riding masses beyond that of a rigid body; body axes, which turn at `rate`."""
        place = start + speed * time + 0.5 * pull * time**2
        path = riding.home + np.einsum("s,bsi->bi", place, riding.travel)
        swift = np.einsum("s,bsi->bi", speed + pull * time, riding.travel)
        turned = np.cross(path, np.cross(rate, path) + swift)
        return riding.mass @ turned

    gained = (momentum(step) - momentum(-step)) / (2.0 * step)
    sliding = riding.mass @ np.cross(
        riding.home + np.einsum("s,bsi->bi", start, riding.travel),
        np.einsum("s,bsi->bi", speed, riding.travel),
    )
    torque = gained + np.cross(rate, sliding)
    rows = [value[None] for value in (rate, start, speed, pull)]
    result = missed(platform.inertia, riding, *rows)[0]
    np.testing.assert_allclose(-platform.inertia @ result, torque, rtol=1e-6, atol=1e-12)


def test_hanging_machine_has_its_mass_moment_along_gravity():
    up = np.array([-np.sin(np.radians(-2.93)), 0.0, 0.0])
    moment = hanging()
    assert moment[2] == astros().center_of_mass_offset[2]
    assert moment[0] / -moment[2] == pytest.approx(-up[0] / np.cos(np.radians(3.34)), rel=2e-3)


@pytest.mark.slow
def test_filter_of_three_offsets_claims_no_less_than_the_bound_and_reaches_it():
    platform = machine(-5e-6, 5e-6)
    gyro = platform.sensors["gyro"]
    biased = dataclasses.replace(gyro, bias=np.full(3, 1e-3))
    platform = dataclasses.replace(platform, sensors={**platform.sensors, "gyro": biased})
    bound = offset_bound(platform, VERTICAL_START, 40.0)
    quiet = OffsetFilter(torque_noise=0.0, wheel_noise=0.0)
    run = swing(platform, quiet, 40.0, 20, ("offset_covariance",))
    claimed = run.believed["offset_covariance"][-1]
    least = np.sqrt(np.diag(bound))
    sigma = np.sqrt(np.diagonal(claimed, axis1=1, axis2=2))
    # each run's claim is along its own estimate, the bound along the true motion
    np.testing.assert_allclose((sigma / least).mean(axis=0), 1.0, rtol=0.02)
    np.testing.assert_allclose(sigma / least, 1.0, rtol=0.15)


BRIEF = 22.0
"""[s]; what is averaged over the last 20 s has some."""


@pytest.fixture
def brief(monkeypatch):
    """Each flight ends early: all that the parts compute of it is asked for, not what it is."""
    whole = flown

    def cut(platform, law, estimator, start, duration, *, seeds=1, **more):
        seeds, duration = min(seeds, 2), min(duration, BRIEF)
        return whole(platform, law, estimator, start, duration, seeds=seeds, **more)

    monkeypatch.setattr(paper_001, "flown", cut)
    for name in ("EXPERIMENT_DURATION", "IN_PLANE_DURATION", "VERTICAL_DURATION"):
        monkeypatch.setattr(paper_001, name, BRIEF)
    monkeypatch.setattr(paper_001, "BEGIN", 0.5 * BRIEF)


@pytest.mark.slow
@pytest.mark.parametrize(
    "part",
    [part for part in PARTS if part.ids[0] != "001.fig10.three_offsets"],
    ids=lambda part: part.ids[0],
)
def test_part_computes_all_that_it_promises(part, brief):
    """As it is, and one that takes minutes: `twin reproduce 001`."""
    del brief
    found = part.compute(lambda doing: None)
    assert set(found.rows) == set(part.ids)
    assert all(svg.lstrip().startswith("<svg") for svg in found.figures.values())
