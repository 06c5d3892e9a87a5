"""A way of balancing has gains for the machine at hand, not for its paper's."""

import pytest

from twin.platform import load_platform
from twin.procedures import balancing, usual_target
from twin.procedures.means import mean_inertia

MACHINES = ("astros", "cubesat", "sads", "tas2", "whorl2")


@pytest.mark.parametrize("name", MACHINES)
def test_masses_level_every_machine_as_fast_and_as_stably_as_their_papers(name: str):
    platform = load_platform(name)
    procedure = balancing(platform, 1, way="masses", target=usual_target(platform), workers=0)
    law, inertia = procedure.level, mean_inertia(platform)
    assert law is not None
    # 001: J = 16.5 kg m^2, K_w = 5 N m s; a body that is damped within a tick is thrown
    assert law.derivative / inertia == pytest.approx(5.0 / 16.5, rel=0.01)
    assert law.derivative / inertia * platform.tick < 0.1
    assert law.integral < law.derivative * law.proportional / inertia, "Routh, without gravity"
