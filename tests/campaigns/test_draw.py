"""What a run is depends on the specification and its number alone, and is spread as it says."""

import numpy as np
import pytest
from scipy.stats import kstest

from twin.campaigns.distribution import shares
from twin.campaigns.draw import draw, start_of_runs
from twin.plant.initial import hanging
from twin.rotation import rotate

NAMES = ("a", "b", "c")


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_any_few_samples_are_those_of_all(sampling):
    every = shares(sampling, range(100), 100, NAMES, 5)
    for few in ([0], [99], [17, 18, 60], list(range(32, 64))):
        assert np.array_equal(shares(sampling, few, 100, NAMES, 5), every[few])


@pytest.mark.parametrize("sampling", ["random", "latin_hypercube", "sobol"])
def test_shares_are_uniform_unlike_each_other_and_follow_the_seed(sampling):
    found = shares(sampling, range(1024), 1024, NAMES, 5)
    for column in found.T:
        assert kstest(column, "uniform").pvalue > 1e-3
    assert np.abs(np.corrcoef(found.T) - np.eye(3)).max() < 0.12
    assert not np.array_equal(found, shares(sampling, range(1024), 1024, NAMES, 6))


@pytest.mark.parametrize("count", [1, 2, 7, 1000, 1024])
def test_a_latin_hypercube_has_one_sample_in_each_stratum(count):
    found = shares("latin_hypercube", range(count), count, NAMES, 5)
    for column in found.T:
        assert sorted(np.floor(column * count).astype(int).tolist()) == list(range(count))


def test_each_sample_meets_every_combination_of_grid_and_arms(spec_of):
    spec = spec_of()
    assert (spec.points, spec.samples) == (2, 12)
    drawn = draw(spec, range(24))
    gains = drawn.values["gains.derivative"]
    assert gains.tolist() == [1e-3, 2e-3] * 12
    width = drawn.values["effects.stage_backlash.width"]
    assert np.array_equal(width[::2], width[1::2]), "the comparison is a paired one"
    assert len(set(width.tolist())) == 12


def test_a_run_is_drawn_alike_alone_and_among_others(spec_of):
    spec = spec_of()
    every = draw(spec, range(24))
    for run in (0, 7, 23):
        alone = draw(spec, [run])
        assert {n: v[0] for n, v in alone.values.items()} == {
            name: value[run] for name, value in every.values.items()
        }


def test_values_stay_where_the_distribution_has_them(spec_of):
    spec = spec_of(("[effects.gyro_bias]", "[effects.gyro_bias]\nbias = { normal = [1.0, 5.0] }"))
    drawn = draw(spec, range(24))
    width = drawn.values["effects.stage_backlash.width"]
    assert width.min() >= 5e-6
    assert width.max() <= 2e-5
    low, high = (f(drawn.values["effects.gyro_bias.bias_x"]) for f in (np.min, np.max))
    (kind,) = (e.kind for e in spec.arms[0].effects if e.kind.name == "gyro_bias")
    assert kind.bounds()[0][0] <= low < high <= kind.bounds()[1][0], "cut off at its bounds"


def test_a_body_that_hangs_has_its_centre_of_mass_below():
    moments = np.array([[1e-3, 0.0, -2e-3], [-1e-3, 3e-3, -1e-3], [0.0, 0.0, -1.0]])
    down = rotate(hanging(moments, np.pi), moments)
    length = np.linalg.norm(moments, axis=1)
    np.testing.assert_allclose(down, -length[:, None] * np.array([0.0, 0.0, 1.0]), atol=1e-12)
    stopped = rotate(hanging(moments, 0.1), np.array([0.0, 0.0, 1.0]))
    assert np.arccos(stopped[:, 2]).max() < 0.1 + 1e-9


def test_a_component_without_room_is_the_same_in_all_runs(spec_of):
    spec = spec_of(("[2e-5, 2e-5, -1e-4]]", "[2e-5, -2e-5, -1e-4]]"))
    names = [factor.name for factor in spec.factors]
    assert "initial.center_of_mass_offset.y" not in names
    drawn = draw(spec, range(24))
    start = start_of_runs(spec.initial, spec.arms[0], drawn)
    offset = np.asarray(start.center_of_mass_offset)
    assert set(offset[:, 1].tolist()) == {-2e-5}
    assert len(set(offset[:, 0].tolist())) == 12
