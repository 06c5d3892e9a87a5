"""Whatever a verb does when a signal comes, it ends in time and leaves nothing half."""

import random
import sys

import pytest

from tests.promises.stops import VERBS, Trials, draw

pytestmark = [
    pytest.mark.slow(50),
    pytest.mark.skipif(sys.platform != "linux", reason="nobody lists processes there"),
]


def test_verbs_that_are_drawn_keep_their_promises_when_a_signal_comes_at_a_drawn_moment(tmp_path):
    seed = random.randrange(1 << 31)
    print(f"seed {seed}")
    chance, trials = random.Random(seed), Trials(tmp_path)
    for name in chance.sample(sorted(VERBS), 6):
        drawn = draw([name], chance)
        ended = trials.outcome(drawn)
        assert not ended.broken, f"{drawn.words()}: {ended.words()}"
