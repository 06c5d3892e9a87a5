"""Frames, mirrored axes and Euler angles on several machines: a part of the panel, drawn anew."""

import secrets

import numpy as np
import pytest
from scipy.stats import binom

from tests.conventions import frames_panel

BY_CHANCE = 1e-3
"""How often a part of the panel may fall short though the whole keeps its promise."""
NAMED = 0.9
"""Share of the visible mistakes that is named, alone or in a tie, as the panel has it."""
WRONG = 0.01
"""Share of all logs that may be given wrong advice as sure, where the panel had none."""
FLIGHTS = 2
"""Each of another machine."""


@pytest.mark.slow(150)
def test_frames_are_named_on_several_machines_and_wrong_advice_is_rare():
    seed = secrets.randbits(20)
    print("seed", seed)
    machines = np.random.default_rng(seed).permutation(list(frames_panel.LAWS))[:FLIGHTS]
    rows = [row for name in machines for row in frames_panel.fly_and_check(str(name), seed)]
    print(frames_panel.table(rows))
    wrong = [row for row in rows if row.verdict in ("wrong", "doubted") or row.parted]
    assert len(wrong) <= binom.isf(BY_CHANCE, len(rows), WRONG), wrong
    seen = [row for row in rows if row.visible and row.kind != "right"]
    named = sum(row.verdict in ("named", "tied") for row in seen)
    assert named >= binom.ppf(BY_CHANCE, len(seen), NAMED), f"{named} of {len(seen)} named"
