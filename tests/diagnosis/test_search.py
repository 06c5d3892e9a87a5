"""Causes are chosen by what they explain beside the base, and by no more than that."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from twin.diagnosis.screen import LinearScreen, Search, Trace, price

FREE = np.full(1, np.inf)
SEED = 20261121


def screen(rng: np.random.Generator, truth: np.ndarray, traces: list[Trace], columns: np.ndarray):
    base = rng.normal(size=(len(columns), 4))
    noise = rng.normal(size=len(columns))
    return LinearScreen(noise + base @ rng.normal(size=4) - columns @ truth, base, columns, traces)


def trace(name: str, numbers: int = 1, low: float = -np.inf) -> Trace:
    return Trace(name, np.full(numbers, low), np.full(numbers, np.inf))


@pytest.fixture
def rng() -> np.random.Generator:
    print(f"seed {SEED}")
    return np.random.default_rng(SEED)


def test_a_hidden_cause_is_named_alone_and_sized(rng):
    columns = rng.normal(size=(500, 6))
    truth = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    found = screen(rng, truth, [trace(n) for n in "abcdef"], columns)
    search = Search(found, range(6))
    assert search.best() == (1,)
    (strength,) = found.weigh((1,)).strengths
    assert strength == pytest.approx(1.0, abs=4.0 / np.sqrt(500))


def test_two_hidden_causes_are_both_named(rng):
    columns = rng.normal(size=(500, 6))
    truth = np.array([0.0, 1.0, 0.0, 0.0, -0.6, 0.0])
    search = Search(screen(rng, truth, [trace(n) for n in "abcdef"], columns), range(6))
    assert sorted(search.best()) == [1, 4]


def test_nothing_is_named_in_noise_more_often_than_is_allowed():
    logs, named = 300, 0
    for machine in range(10):
        rng = np.random.default_rng(machine)
        base, columns = rng.normal(size=(60, 4)), rng.normal(size=(60, 8))
        traces, limit = [trace(n) for n in "abcdefgh"], None
        for _ in range(logs // 10):
            search = Search(
                LinearScreen(rng.normal(size=60), base, columns, traces), range(8), limit
            )
            limit = search.limit
            named += bool(search.best())
    print(f"named in {named} of {logs}")
    assert named <= 4, "0.3 % were promised; more than 4 of 300 has a chance of 0.2 %"


def test_the_best_of_many_frequencies_is_weighed_as_that():
    logs, many, told, untold, limit = 300, 400, 0, 0, None
    for seed in range(logs):
        rng = np.random.default_rng(seed)
        noise, base = rng.normal(size=60), rng.normal(size=(60, 4))
        columns = rng.normal(size=(60, many))
        best = int(np.argmax(np.abs(noise @ columns) / np.linalg.norm(columns, axis=0)))
        one = Trace("line", -FREE, FREE)
        # what noise reaches with one column does not depend on which it is
        alone = Search(LinearScreen(noise, base, columns[:, [best]], [one]), range(1), limit)
        limit = alone.limit
        looked = [replace(one, looked=np.log(many))]
        found = Search(LinearScreen(noise, base, columns[:, [best]], looked), range(1), limit)
        untold += bool(alone.best())
        told += bool(found.best())
    print(f"named in {told} of {logs}, and in {untold} where nobody tells how many there were")
    assert told <= 4
    assert untold > 50, "else there is nothing to weigh for"


def test_what_the_base_does_as_well_is_not_asked(rng):
    base = rng.normal(size=(200, 2))
    columns = np.column_stack([base[:, 0] + base[:, 1], rng.normal(size=200)])
    found = LinearScreen(rng.normal(size=200), base, columns, [trace("base's"), trace("own")])
    assert Search(found, range(2)).asked == (1,)


def test_what_a_fit_has_settled_stays_though_a_little_less_of_it_shows_beside_the_base(rng):
    base = rng.normal(size=(400, 4))
    # 0.8 % of it is no base's
    column = 2e4 * base[:, :1] / np.linalg.norm(base[:, 0])
    column += 160.0 * rng.normal(size=(400, 1)) / np.sqrt(400)
    noise = rng.normal(size=400)
    asked, settled = (
        LinearScreen(noise - column[:, 0], base, column, [replace(trace("a"), fitted=fitted)])
        for fitted in (False, True)
    )
    assert not asked.identifiable(0), "it may be no more than the error of a linearised base"
    assert settled.identifiable(0)
    assert Search(settled, range(1)).best() == (0,)


@pytest.mark.parametrize("constant", [True, False])
def test_a_constant_error_beyond_what_is_stated_of_it_is_named(rng, constant):
    samples, stated, true = 10_000, 2.0, 20.0
    shown = np.append(np.ones((samples, 1)), [[0.0]], axis=0)
    # the base has the same constant, and knows how large it should be
    base = np.append(np.ones((samples, 1)), [[1.0 / stated]], axis=0)
    residual = rng.normal(size=samples + 1) - true * shown[:, 0]
    found = LinearScreen(residual, base, shown, [replace(trace("bias"), exact=constant)])
    assert Search(found, [0]).best() == ((0,) if constant else ())
    if constant:
        (strength,) = found.weigh((0,)).strengths
        assert strength == pytest.approx(true, abs=4.0 * stated)


def test_a_friction_that_drives_is_no_friction(rng):
    columns = rng.normal(size=(300, 1))
    found = screen(rng, np.array([-1.0]), [trace("friction", low=0.0)], columns)
    assert Search(found, range(1)).best() == ()
    (strength,) = found.weigh((0,)).strengths
    assert strength == 0.0


def test_of_two_that_look_alike_both_are_told(rng):
    one = rng.normal(size=400)
    columns = np.column_stack([one, one + 0.02 * rng.normal(size=400), rng.normal(size=400)])
    found = screen(rng, np.array([1.0, 0.0, 0.0]), [trace(n) for n in "abc"], columns)
    search = Search(found, range(3))
    (chosen,) = search.best()
    other, behind = search.instead((chosen,), chosen)[0]
    assert {chosen, other} == {0, 1}
    assert abs(behind) < 6.0


def test_several_that_can_each_be_done_without_do_not_have_together_for_nothing_what_one_does(rng):
    space = rng.normal(size=(500, 5))
    columns = np.column_stack([space @ rng.normal(size=(5, 9)), space[:, 0]])
    traces = [trace("a", 3), trace("b", 3), trace("c", 3), trace("d")]
    found = screen(rng, np.append(np.zeros(9), 2.0), traces, columns)
    search = Search(found, range(4))
    gain = [found.weigh(some).gain for some in ((0, 1), (0, 2), (1, 2), (0, 1, 2))]
    assert gain == pytest.approx(gain[:1] * 4), "any two of the three do as well as all of them"
    assert search.evidence((3,)) > search.evidence((0, 1, 2)) + 6.0


def test_a_vector_explains_no_more_than_its_numbers_are_worth():
    assert price(60.0, np.full(3, 0.1)) == pytest.approx(3.0 * (1.0 + np.log(20.0)))
    assert price(0.5, np.ones(1)) == 1.0
    hardly = np.array([1.0, 1e-6, 1e-6])
    assert price(60.0, hardly) == pytest.approx(price(58.0, hardly[:1]) + 2.0, abs=1e-3)


def test_what_noise_gains_beyond_a_set_is_chi_square_however_like_the_base_the_others_are(rng):
    base = rng.normal(size=(300, 4))
    like = base @ rng.normal(size=(4, 20)) + 0.05 * rng.normal(size=(300, 20))
    chances = []
    for _ in range(400):
        found = LinearScreen(rng.normal(size=300), base, like, [trace(str(i)) for i in range(20)])
        gain, freedom = found.beyond((0,), range(1, 20))
        chances.append(chi2.sf(gain, freedom))
    assert np.mean(np.array(chances) < 0.05) == pytest.approx(0.05, abs=0.04)
    assert np.mean(chances) == pytest.approx(0.5, abs=0.06)
