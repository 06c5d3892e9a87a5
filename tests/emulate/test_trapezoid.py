"""The drive's motion: the manual's worked example, and the laws of a ramp."""

import pytest

from twin.emulate.mdrive import Ramps, at_rest, move, slew, stop

FACTORY = Ramps(1000.0, 768_000.0, 1e6, 1e6)


def test_the_manuals_worked_example_takes_5_77_seconds():
    profile = move(0.0, 3_840_000.0, FACTORY, 0.0)
    assert [stretch.span for stretch in profile.stretches] == pytest.approx(
        [0.767, 4.232, 0.767], abs=5e-4
    ), "the manual rounds the cruise to 4.233 s, and the whole to 5.767 s"
    assert profile.end == pytest.approx(5.7660, abs=1e-4)


def test_one_turn_never_reaches_full_speed():
    profile = move(0.0, 51_200.0, FACTORY, 0.0)
    assert profile.end == pytest.approx(0.4506, abs=1e-4)
    assert profile.at(profile.stretches[1].start)[1] == pytest.approx(226_276.0, abs=1.0)


@pytest.mark.parametrize("target", [1.0, -1.0, 500.0, -51_200.0, 3_840_000.0])
@pytest.mark.parametrize("down", [1e6, 3e5])
def test_a_move_is_continuous_within_its_speed_and_ends_on_its_target(target, down):
    ramps = Ramps(1000.0, 768_000.0, 1e6, down)
    profile = move(10.0, 10.0 + target, ramps, 2.0)
    for before, after in zip(profile.stretches, profile.stretches[1:], strict=False):
        assert before.at(after.start) == pytest.approx(after.at(after.start), rel=1e-9, abs=1e-6)
    last = profile.stretches[-1]
    assert last.at(profile.end)[0] == pytest.approx(10.0 + target, abs=1e-6)
    assert abs(last.at(profile.end)[1]) == pytest.approx(1000.0)
    assert profile.at(profile.end + 1.0) == (10.0 + target, 0.0)


def test_stopping_takes_the_ramp_from_whatever_speed():
    running = slew(0.0, -500_000.0, FACTORY, 0.0)
    assert running.at(10.0)[1] == -500_000.0
    stopped = stop(running, FACTORY, 10.0)
    assert stopped.end == pytest.approx(10.499)
    assert stopped.at(20.0)[1] == 0.0
    travelled = (500_000.0**2 - 1000.0**2) / 2e6
    assert running.at(10.0)[0] - stopped.target == pytest.approx(travelled, abs=1.0)
    assert stop(at_rest(5.0), FACTORY, 1.0).at(2.0) == (5.0, 0.0)
