"""A log whose recorder stood still for a while is several logs, and says no less for it."""

import numpy as np

from twin.recording import Recording, Series
from twin.recording.pauses import longest_of, pieces_of


def log(*stretches: tuple[float, float], rate: float = 50.0) -> Recording:
    """Of a gyro that was on in these stretches [s], and a command now and then."""
    time = np.concatenate([np.arange(start, stop, 1.0 / rate) for start, stop in stretches])
    told = np.array([0.0, 15.0, 3620.0])
    return Recording(
        {
            "gyro": Series(time, np.zeros((len(time), 3)), ("x", "y", "z"), "rad/s"),
            "command_wheel_torque": Series(told, told[:, None], ("w1",), "N m"),
        },
        {"source": "monday"},
    )


def test_a_log_with_short_gaps_is_one():
    whole = log((0.0, 20.0), (24.0, 40.0), (42.5, 60.0))
    assert pieces_of(whole) == [whole]


def test_a_slow_log_has_no_pause_between_its_samples():
    whole = log((0.0, 600.0), rate=0.1)
    assert pieces_of(whole) == [whole]


def test_a_log_is_parted_where_it_paused_and_what_was_commanded_holds():
    first, second = pieces_of(log((0.0, 20.0), (3600.0, 3650.0)))
    assert first["gyro"].time[-1] < 20.0
    assert second["gyro"].time[0] == 3600.0
    np.testing.assert_array_equal(first["command_wheel_torque"].time, [0.0, 15.0])
    np.testing.assert_array_equal(second["command_wheel_torque"].time, [3600.0, 3620.0])
    np.testing.assert_array_equal(second["command_wheel_torque"].value[:, 0], [15.0, 3620.0])
    assert first.repairs == (
        "monday: nothing shows the motion from 19.98 to 3600 s: it is taken as 2 logs",
    )


def test_commands_of_a_clock_keep_their_ticks_where_a_log_is_parted():
    told = np.arange(0.0, 60.0, 0.05)
    shown = np.r_[np.arange(0.0, 20.0, 0.02), np.arange(40.013, 60.0, 0.02)]
    streams = {
        "gyro": Series(shown, np.zeros((len(shown), 3)), ("x", "y", "z"), "rad/s"),
        "command_stage_position": Series(told, np.sin(told)[:, None], ("s1",), "m"),
    }
    _, second = pieces_of(Recording(streams, {"source": "monday"}))
    kept = second["command_stage_position"]
    np.testing.assert_array_equal(kept.time, told[-len(kept) :])
    assert 38.9 < kept.time[0] < 39.1, "what a stage was still following"
    told = told[(told < 19.0) | (told > 40.1)]
    streams["command_stage_position"] = Series(told, np.sin(told)[:, None], ("s1",), "m")
    _, second = pieces_of(Recording(streams, {"source": "monday"}))
    held = second["command_stage_position"]
    np.testing.assert_allclose(held.time[:2], [40.0, 40.15])
    assert held.value[0, 0] == np.sin(18.95)


def test_a_stretch_that_tells_nothing_is_left_out_and_said_to_be():
    (only,) = pieces_of(log((0.0, 20.0), (100.0, 101.0)))
    assert only["gyro"].time[-1] < 20.0
    assert "taken as one log, and one log shorter than 5 s left out" in only.repairs[0]


def test_who_looks_at_one_log_looks_at_the_longest_part():
    longest = longest_of(log((0.0, 20.0), (100.0, 150.0), (200.0, 210.0)))
    assert longest["gyro"].time[0] == 100.0
    assert "taken as 3 logs, of which the longest is looked at" in longest.repairs[0]
