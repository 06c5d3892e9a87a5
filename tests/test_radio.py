"""The radio between machines: when messages come, what is lost, and in whose axes they are."""

import numpy as np
import pytest

from twin.controller.pointing import pointing_error
from twin.errors import UnknownName, UsageError
from twin.estimators.estimator import blank
from twin.platform import load_platform
from twin.radio import Airwaves, Radio, Station, as_estimated, parse_radio
from twin.rotation import from_rotation_vector, multiply, rotate
from twin.signals import Target

TICK = 0.02
WHORL = load_platform("whorl1")
PAIR = (Station("a"), Station("b"))


def estimate(time: float, n: int = 1, **fields):
    known = blank(WHORL, n)
    known.time, known.valid = time, np.ones(n, dtype=bool)
    known.rate_body = np.full((n, 3), time)
    for name, value in fields.items():
        setattr(known, name, value)
    return known


def heard(radio: Radio, ticks: int, n: int = 1, seed: int = 0) -> np.ndarray:
    """(ticks, n) time of the newest message of a that b has at each of its ticks."""
    air = Airwaves(radio, PAIR, range(n), seed)
    rows = []
    for tick in range(ticks):
        now = tick * TICK
        if air.due("a", now):
            air.send("a", now, estimate(now, n), {})
        newest = air.received("b", now).get("a")
        rows.append(np.full(n, np.nan) if newest is None else newest.time)
    return np.array(rows)


def test_without_delay_a_message_is_known_at_the_tick_at_which_it_is_sent():
    times = heard(Radio(), 50)[:, 0]
    assert np.allclose(times, np.arange(50) * TICK)


@pytest.mark.parametrize("delay", [0.02, 0.1, 0.11])
def test_a_message_is_known_at_the_first_tick_after_its_delay(delay):
    times = heard(Radio(delay=delay), 50)[:, 0]
    late = int(np.ceil(delay / TICK - 1e-9))
    assert np.isnan(times[:late]).all()
    assert np.allclose(times[late:], np.arange(50 - late) * TICK)


def test_messages_leave_at_the_first_tick_after_each_period():
    times = np.unique(heard(Radio(rate=12.0), 101)[:, 0])
    periods = np.arange(25) / 12.0
    assert np.allclose(times, np.ceil(periods / TICK - 1e-9) * TICK)


def test_losses_have_their_share_and_are_those_of_seed_and_run(drawn_seed):
    alone = heard(Radio(loss=0.3), 2000, seed=drawn_seed)
    three = heard(Radio(loss=0.3), 2000, n=3, seed=drawn_seed)
    fresh = three == (np.arange(2000) * TICK)[:, None]
    assert np.array_equal(alone[:, 0], three[:, 0], equal_nan=True)
    assert not np.array_equal(fresh[:, 0], fresh[:, 1])
    # 5 sigmas of 6000 draws
    assert fresh.mean() == pytest.approx(0.7, abs=5.0 * np.sqrt(0.21 / 6000.0))


def test_a_lost_message_leaves_the_one_before():
    times = heard(Radio(loss=0.5), 400, n=2, seed=3)
    kept = times[np.isfinite(times).all(axis=1)]
    assert (np.diff(kept, axis=0) >= 0.0).all()
    assert (kept[:-1] == kept[1:]).any()


def test_a_radio_that_is_cut_carries_nothing():
    assert np.isnan(heard(Radio(loss=1.0), 50)).all()
    assert parse_radio("off") == Radio(loss=1.0)


def test_a_machine_that_has_not_seen_itself_is_not_heard():
    air = Airwaves(Radio(), PAIR, (0, 1), 0)
    air.send("a", 0.0, estimate(0.0, 2, valid=np.array([True, False])), {})
    assert air.received("b", 0.0)["a"].valid.tolist() == [True, False]


def test_a_machine_hears_those_that_it_is_said_to_hear():
    names = [Station(name) for name in "abc"]
    air = Airwaves(Radio(hears={"b": ["a"], "a": []}), names, (0,), 0)
    for name in "abc":
        air.send(name, 0.0, estimate(0.0), {"x": np.zeros((1, 2))})
    assert [set(air.received(name, 0.0)) for name in "abc"] == [set(), {"a"}, {"a", "b"}]
    assert air.received("c", 0.0)["a"].extra["x"].shape == (1, 2)


def test_a_place_comes_in_the_room_of_the_machine_that_receives_it():
    far = (Station("a", True, (1.0, 2.0, 0.0)), Station("b", True, (4.0, 2.0, 0.0)))
    air = Airwaves(Radio(), far, (0,), 0)
    here = {"position": np.array([[0.5, 0.0, 0.0]]), "velocity": np.array([[0.1, 0.0, 0.0]])}
    air.send("a", 0.0, estimate(0.0, **here), {})
    there = air.received("b", 0.0)["a"]
    assert there.position is not None
    assert np.allclose(there.position, [[-2.5, 0.0, 0.0]])


def test_relative_motion_is_that_of_the_error_from_a_target(drawn_seed):
    """With the other machine for a target, laws see the same numbers as the recording."""
    rng = np.random.default_rng(drawn_seed)
    turns, rates = from_rotation_vector(rng.normal(size=(2, 3))), rng.normal(size=(2, 3))
    air = Airwaves(Radio(), PAIR, (0,), 0)
    air.send("a", 0.0, estimate(0.0, attitude=turns[:1], rate_body=rates[:1]), {})
    own = estimate(0.0, attitude=turns[1:], rate_body=rates[1:])
    own.received = air.received("b", 0.0)
    error, rate = pointing_error(own, Target(turns[0], rates[0]))
    streams = as_estimated(own)
    turn = streams["relative_attitude_to_a"].value[0]
    assert np.allclose(np.abs(np.sum(turn * error)), 1.0)
    assert np.allclose(streams["relative_rate_to_a"].value[0], rate)
    # d/dt of q_a^* q_b, by small turns of both
    step = 1e-6
    moved = [
        multiply(turn, from_rotation_vector(step * rate))
        for turn, rate in zip(turns, rates, strict=True)
    ]
    after = multiply(moved[0] * [1, -1, -1, -1], moved[1])
    shown = multiply(turn[0], from_rotation_vector(step * rate[0]))
    assert np.allclose(after, shown, atol=1e-11)
    assert np.allclose(rotate(turn[0], rate[0]), rotate(turn[0], rates[1]) - rates[0])


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("delay=-1", "delay is -1 s"),
        ("loss=1.5", "loss is 1.5"),
        ("rate=0", "rate is 0 Hz"),
        ("delay=x", "delay is 'x'"),
        ("late=1", "'late=1' is not understood; give delay, loss, rate"),
        ("delay=1,delay=2", "'delay=2' is not understood"),
    ],
)
def test_a_radio_that_cannot_be_is_refused(text, what):
    with pytest.raises(UsageError, match="radio") as refused:
        parse_radio(text)
    assert what in str(refused.value)


def test_a_machine_that_is_not_there_cannot_be_heard():
    with pytest.raises(UnknownName, match="whorl3"):
        Airwaves(Radio(hears={"a": ["whorl3"]}), PAIR, (0,), 0)
