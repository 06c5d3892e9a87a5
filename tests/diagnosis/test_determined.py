"""What a log can show of an effect is what its fit moves."""

import numpy as np
import pytest

from tests.predict.flights import flown
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.explanation import determined
from twin.effects.actuators import ThrusterMisalignment
from twin.effects.wheels import WheelMisalignment
from twin.platform import load_platform
from twin.predict.columns import slopes_of

SEED = 20261123


@pytest.mark.parametrize(
    ("kind", "law"), [(ThrusterMisalignment, "thruster_pd"), (WheelMisalignment, "quaternion_pd")]
)
def test_a_part_turns_across_its_own_axis_however_it_is_turned_already(kind: type, law: str):
    whorl1, rng = load_platform("whorl1"), np.random.default_rng(SEED)
    plain = baseline_of([flown("whorl1", SEED, 20.0, law)], whorl1)
    thrusters = kind is ThrusterMisalignment
    for part in whorl1.thrusters if thrusters else whorl1.wheels:
        axis = np.abs(part.direction if thrusters else part.axis)
        assert axis.max() == pytest.approx(1.0)
        rotation = rng.uniform(-0.04, 0.04, 3) * (1.0 - axis)
        effect = kind(target=part.name, rotation=tuple(rotation))
        every = [slopes_of(effect, whorl1)]
        (free,) = determined(plain.bodies, plain.base, (effect,), every, plain.at)
        assert not free[np.argmax(axis)], (part.name, rotation, free)
