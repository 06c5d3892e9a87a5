"""What measured logs of a pendulum say, and what a second log says of a fit to the first."""

from collections.abc import Callable

import pytest

from twin.comparison import compare, transfer
from twin.library import library
from twin.platform import Platform, platform_of
from twin.recording import Recording, open_log
from twin.report import document, sentences, transfer_sentences

SEED = 20260214
LOGS = library("models") / "dfki_pendulum" / "logs"

Swings = Callable[..., Recording]


def test_another_mass_is_seen_when_a_fitted_model_is_moved(swing: Swings, pendulum: Platform):
    first = compare(swing(seed=SEED, duration=6.0, dry=0.05), pendulum)
    more = {"inertia": 0.1367 * 1.5, "moment": 0.273 * 1.5}
    heavy = compare(swing(seed=SEED + 1, duration=6.0, dry=0.05, **more), pendulum)
    moved = transfer(first, heavy)
    said = transfer_sentences(moved, first)
    assert not moved.explained.follows
    assert any(s.startswith("J differs") and "1.5 times as much" in s for s in said)
    assert said[-1].startswith("They differ by one factor: another mass at the same place")


@pytest.mark.parametrize(
    "name",
    ["sysid", "energy_shaping", pytest.param("energy_shaping_1kg", marks=pytest.mark.slow)],
)
def test_friction_is_named_in_each_measured_log(name: str):
    log = open_log(LOGS / name)
    comparison = compare(log, platform_of(log))
    assert "(dry friction)" in sentences(comparison)[0]
    assert comparison.verdict == "unexplained", "backlash and pushes are left"
    assert document([comparison], [])["logs"][0]["verdict"] == "unexplained"


def test_a_gain_of_all_thrusters_is_no_law_beside_a_mass_that_is_fitted():
    log = open_log(library("models") / "kentucky_planar" / "logs" / "mission").between(0.0, 60.0)
    comparison = compare(log, platform_of(log))
    assert comparison.refitted is not None
    named, asked = (
        {item.symptom.name for item in items}
        for items in (comparison.refitted.strengths, comparison.as_built.scores)
    )
    assert "thruster_gain" in asked
    assert "thruster_gain" not in named
    assert "command_delay" in named
