"""An only cause is held against its rivals as they are when fitted, not as its fit shows them."""

import pytest

from tests.seeds import seed_of
from twin.clock import SimulatedClock
from twin.controller import load_controller
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.candidates import candidates_of
from twin.diagnosis.engine import Engine, SearchState, guesses
from twin.effects import effect_named, with_effects
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.reference import parse_reference
from twin.stream.recorder import MemoryRecorder


@pytest.fixture(scope="module")
def state(request: pytest.FixtureRequest) -> SearchState:
    """Of slow slews that rub a little; drag does nearly the same."""
    seed = seed_of(request)
    platform = load_platform("sads")
    rubbing = effect_named("bearing_viscous_friction")(damping=0.001)
    memory = MemoryRecorder(platform)
    fly(
        SimulatedPlant(with_effects(platform, (rubbing,)), seed=seed),
        load_estimator("filter"),
        load_controller("quaternion_pd"),
        parse_reference("slew:10,-10,120@5"),
        SimulatedClock(),
        duration=60.0,
        observers=[memory],
    )
    plain = baseline_of([memory.recording().without_truth()], platform)
    asked = candidates_of(plain.bodies).asked
    now = plain.instead((rubbing,))
    return SearchState(now, asked)


@pytest.mark.slow
def test_whichever_of_two_rivals_the_search_ended_at_the_answer_is_the_same(state: SearchState):
    engine = Engine(state.candidates, lambda _: None)
    best = engine.against_rivals(state)
    (own,) = best.explanation.effects
    others = {
        next(iter(labels)): behind
        for labels, behind in engine.others(best).items()
        if len(labels) == 1 and own.label not in labels
    }
    assert others, "drag and viscous friction are rivals in a slew"
    label = min(others, key=lambda one: others[one])
    screen = best.search.screen
    place = next(i for i, _ in best.search.instead((0,), 0) if screen.traces[i].label == label)
    there = best.explanation.instead(guesses(best.explanation, best.candidates, screen, (place,)))
    again = engine.against_rivals(SearchState(there, best.candidates))
    (found,) = again.explanation.effects
    assert found.label == own.label
    behind = engine.others(again)[frozenset([label])]
    assert behind == pytest.approx(others[label], abs=1.0)
