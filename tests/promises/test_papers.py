"""What the papers' authors met in their own machines is found in logs of ours. Seeds are printed.

`python -m benchmarks.papers` writes what is answered to each, docs/papers_found.md.
"""

import numpy as np
import pytest

from benchmarks.papers import FAULTS, SEED
from twin.diagnosis import Diagnosis
from twin.diagnosis.cause import Cause


def diagnosed(name: str, seed: int) -> tuple[Diagnosis, Cause]:
    """What is found, and the cause that was hidden."""
    effect = FAULTS[name].drawn(seed)
    print(f"hidden: {effect.words()}, seed {seed}")
    found = FAULTS[name].diagnosed(effect, seed)
    print(found.verdict, [cause.effect.words() for cause in found.causes])
    own = [cause for cause in found.causes if cause.effect.label == effect.label]
    assert own, f"{effect.label} is not named"
    sure = np.isfinite(own[0].half_widths)
    off = np.abs(own[0].effect.values - effect.values)[sure]
    # four standard deviations
    assert np.all(off < 2.0 * own[0].half_widths[sure]), "the size is another"
    return found, own[0]


@pytest.mark.slow
def test_wheel_speeds_that_come_late_are_found_to_be_and_nothing_else():
    found, cause = diagnosed("late wheels", SEED)
    assert found.verdict == "explained"
    assert len(found.causes) == 1
    assert cause.half_widths[0] < 0.05
    assert cause.effect.values[0] == pytest.approx(
        FAULTS["late wheels"].drawn(SEED).values[0], 0.05
    )


@pytest.mark.slow
def test_a_flywheel_turned_by_a_few_degrees_is_seen_where_the_paper_could_not():
    _, cause = diagnosed("turned flywheel", SEED)
    assert np.nanmax(cause.half_widths) < np.radians(3.6)


@pytest.mark.slow
def test_a_fault_of_the_papers_machines_is_named_and_sized(drawn_seed: int):
    """Two that are drawn; of all of them docs/papers_found.md tells."""
    names = ["inclinometer askew", "gimbal backlash", "gyro off balance", "drag"]
    names += ["late wheels gently"]
    for name in np.random.default_rng(drawn_seed).choice(names, 2, replace=False).tolist():
        diagnosed(name, SEED)


@pytest.mark.slow
def test_steppers_are_found_to_have_play_or_to_shake(drawn_seed: int):
    names = ["stage backlash", "stage vibration"]
    diagnosed(str(np.random.default_rng(drawn_seed).choice(names)), SEED)


@pytest.mark.slow
def test_a_plate_that_rings_is_named_where_the_reference_swings_nearly_as_fast():
    fault = FAULTS["ringing plate"]
    effect = fault.drawn(SEED)
    (cause,) = fault.diagnosed(effect, SEED).causes
    print(f"hidden {effect.words()}, found {cause.effect.words()}")
    assert cause.effect.label == effect.label
    # four standard deviations of frequency, damping and inertia; an axis has no length
    off = np.abs(cause.effect.values - effect.values)[:3]
    assert np.all(off < 2.0 * cause.half_widths[:3])


@pytest.mark.slow
def test_of_a_plate_that_rings_too_softly_it_is_said_how_large_it_would_have_to_be():
    fault = FAULTS["ringing plate gently"]
    effect = fault.drawn(SEED)
    found = fault.diagnosed(effect, SEED)
    assert found.verdict == "healthy"
    (tried,) = [one for one in found.tried if one.label == effect.label]
    (needed,) = tried.detectable
    print(f"hidden {effect.words()}, found from {needed:.3g} {tried.units[0]} on")
    assert effect.values[list(effect.names).index("inertia")] < needed < np.inf
