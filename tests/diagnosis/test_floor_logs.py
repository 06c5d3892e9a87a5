"""The logs of a real machine on a floor, and of its authors' simulator, out of the box."""

import pytest

from twin.diagnosis import Diagnosis, diagnose
from twin.library import library
from twin.platform import load_platform
from twin.recording import open_log

LOGS = library("models") / "kentucky_planar" / "logs"


def diagnosed(name: str, seconds: float = 1000.0) -> Diagnosis:
    log = open_log(LOGS / name).between(0.0, seconds)
    found = diagnose([log], load_platform("kentucky_planar"))
    print(found.verdict, [cause.effect.words() for cause in found.causes], found.wander)
    return found


@pytest.mark.slow
def test_a_real_machine_on_a_floor_has_a_late_thrust_no_drag_and_a_dead_thruster():
    found = diagnosed("mission")
    causes = {cause.effect.label: cause for cause in found.causes}
    assert found.verdict == "explained in part"
    assert set(causes) == {"thruster_delay", "pad_viscous_friction", "nozzle_gain:t2"}
    assert 0.05 < causes["thruster_delay"].effect.values[0] < 0.12
    # the drag that the authors assume, 1.8 N s/m and 0.3 N m s, is hardly there
    assert causes["pad_viscous_friction"].effect.values[0] < -1.0
    assert causes["pad_viscous_friction"].effect.values[1] < -0.2
    assert causes["nozzle_gain:t2"].effect.values[0] < -0.6
    run = found.free_runs[1.0]
    assert run is not None
    assert run.places is not None
    assert run.errors[1] < 0.5 * run.errors[0]
    assert run.places[1] < 0.8 * run.places[0]


@pytest.mark.slow
def test_the_authors_simulator_pushes_sooner_than_they_state_and_adds_a_wander():
    found = diagnosed("simulated_mission", 100.0)
    assert found.verdict == "explained in part"
    (cause,) = found.causes
    assert cause.effect.label == "thruster_delay"
    assert cause.effect.values[0] == pytest.approx(-0.05, abs=0.01)
    assert found.explained.at.theta[0] == pytest.approx(23.09, rel=0.03)
    assert found.wander.torque is not None
