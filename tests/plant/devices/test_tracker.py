"""What is believed of one stage from look to look, and which orders it is given."""

import pytest

from tests.plant.devices.stages import stage
from twin.plant.devices.mdrive import Look, Tracker


@pytest.fixture
def tracker() -> Tracker:
    """A stage that is homed and stands at 0."""
    tracker = Tracker(stage())
    tracker.homed = True
    return tracker


def test_a_stage_that_does_not_move_is_told_though_the_loop_wants_the_same_in_every_tick(tracker):
    orders = []
    for tick in range(20):
        now = 0.2 * tick
        tracker.want(5000, now)
        orders.append(tracker.order(now))
        assert tracker.look(Look(0, moving=False, time=now + 0.1)) == ""
        if tracker.notes:
            break
    assert orders == [5000, 5000, 5000, None]
    assert "does not move, 3 orders were in vain" in tracker.notes[0]


def test_an_order_that_a_stage_has_had_no_time_to_hear_is_not_given_again(tracker):
    tracker.want(5000, 1.0)
    assert tracker.order(1.0) == 5000
    tracker.want(5000, 1.05)
    assert tracker.order(1.05) is None
    tracker.want(4000, 1.06)
    assert tracker.order(1.06) == 4000, "but another one is"


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize("wanted", [0, 1_000_000, -1_000_000])
def test_a_stage_beyond_its_travel_is_let_back_by_its_reach_at_most(tracker, side, wanted):
    settings = tracker.settings
    beyond = side * (settings.steps(settings.travel[1]) + 2 * settings.reach)
    tracker.rest(beyond)
    assert tracker.allow(wanted) == beyond - side * settings.reach


@pytest.mark.parametrize(("code", "open_way"), [(83, -1), (84, 1)])
def test_a_limit_switch_lets_a_stage_go_the_other_way_only(tracker, code, open_way):
    tracker.complain(code)
    reach = tracker.settings.reach
    assert tracker.allow(-open_way * reach) == 0
    assert tracker.allow(open_way * reach) == open_way * reach
