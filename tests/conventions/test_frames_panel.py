"""Frames, mirrored axes and Euler angles on any machine: a part of the panel, drawn anew."""

import numpy as np
import pytest
from scipy.stats import binom

from tests.conventions import frames_panel
from tests.seeds import seed_of

BY_CHANCE = 1e-3
"""How often a part of the panel may fall short though the whole keeps its promise."""
NAMED = 0.9
"""Share of the visible mistakes that is named, alone or in a tie, as the panel has it."""
WRONG = 0.01
"""Share of all logs that may be given wrong advice as sure, where the panel had none."""


@pytest.mark.slow(20)
def test_frames_are_named_on_whatever_machine_and_wrong_advice_is_rare(
    request: pytest.FixtureRequest,
):
    seed = seed_of(request)
    machine = str(np.random.default_rng(seed).choice(list(frames_panel.LAWS)))
    rows = list(frames_panel.fly_and_check(machine, seed))
    print(frames_panel.table(rows))
    wrong = [row for row in rows if row.verdict in ("wrong", "doubted") or row.parted]
    assert len(wrong) <= binom.isf(BY_CHANCE, len(rows), WRONG), wrong
    seen = [row for row in rows if row.visible and row.kind != "right"]
    named = sum(row.verdict in ("named", "tied") for row in seen)
    assert named >= binom.ppf(BY_CHANCE, len(seen), NAMED), f"{named} of {len(seen)} named"
