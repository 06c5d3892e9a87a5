"""Whatever fails at whatever time: a session goes on, degrades or stops, and says why.

`python -m benchmarks.faults` flies many more, docs/faults.md.
"""

import sys

import pytest

if sys.platform == "win32":
    pytest.skip("no pseudo-terminals", allow_module_level=True)

from benchmarks.fault_table import RECORDED, session

SESSIONS = 12


@pytest.mark.slow
@pytest.mark.parametrize("block", range(2))
def test_each_session_under_random_faults_ends_with_a_reason_and_believes_nothing_false(block):
    first = block * SESSIONS // 2
    found = [session(seed) for seed in range(first, first + SESSIONS // 2)]
    for one in found:
        print(one)
        assert not one["problems"], f"seed {one['seed']}: {one}"
    assert {one["ended"] for one in found} <= {"continued", "degraded", "safe_stop", "refused"}


def test_a_session_under_faults_ends_with_a_reason_and_may_be_armed_again_twice():
    found = session(3)
    assert found["seed"] % RECORDED, "no file, which takes its time"
    assert not found["problems"], found
    assert found["ended"] == "safe_stop"
    assert found["again"] == ["armed", "armed"]


def test_a_board_whose_last_word_was_lost_on_the_line_is_not_said_to_take_set_points():
    found = session(164)
    assert found["faults"] == ["duplicate 2.06", "garble 1.78", "unplug 5.32"], (
        "the seed draws other faults now"
    )
    assert found["ended"] == "safe_stop"
    assert "why it said was lost on the line" in found["reason"]
