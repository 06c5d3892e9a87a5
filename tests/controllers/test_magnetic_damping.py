"""Magnetorquers alone against the rate, on the table in its cage."""

from dataclasses import replace

import numpy as np
import pytest

from papers.flown import perfect
from tests.controllers.flight import simulate
from twin.controller import load_controller
from twin.errors import ControllerError
from twin.plant.initial import InitialState
from twin.platform import load_platform
from twin.rotation import from_rotation_vector, vertical_body


@pytest.fixture(scope="module")
def law():
    return load_controller("magnetic_damping")


@pytest.fixture(scope="module")
def hanging():
    """The table, its CM right below the CR."""
    return replace(
        perfect(load_platform("cubesat")), center_of_mass_offset=np.array([0.0, 0.0, -1.2e-4])
    )


def energy(platform, run):
    """Above that of rest (m,) [J]."""
    rate, up = run.true["rate"], vertical_body(run.true["attitude"])
    turning = 0.5 * np.einsum("ni,ij,nj->n", rate, platform.inertia, rate)
    moment = -platform.center_of_mass_offset[2]
    return turning + moment * platform.gravity * (1.0 - up[:, 2])


def test_swing_in_an_upright_field_decays_as_the_gain_says_and_its_spin_stays(law, hanging):
    """exp(-K_d t / J) of its energy, from a small tilt about x; all three axes are principal."""
    start = from_rotation_vector(np.array([0.05, 0.0, 0.0]))
    run = simulate(law, hanging, 40.0, start=InitialState(attitude=start))
    share = energy(hanging, run)[-1] / energy(hanging, run)[0]
    expected = np.exp(-law.derivative * run.time[-1] / hanging.inertia[0, 0])
    # Within a period the energy leads or lags the mean decay by less than the damping ratio.
    stiffness = -hanging.center_of_mass_offset[2] * hanging.gravity
    ratio = 0.5 * law.derivative / np.sqrt(stiffness * hanging.inertia[0, 0])
    assert share == pytest.approx(expected, rel=2.0 * ratio)

    spinning = InitialState(rate_body=np.array([0.0, 0.0, 0.05]))
    run = simulate(law, hanging, 40.0, start=spinning)
    assert run.true["rate"][-1, 2] == pytest.approx(0.05, abs=1e-9)


@pytest.mark.parametrize("limit", [1.0, 0.01], ids=["within limits", "at the coils' limits"])
@pytest.mark.parametrize("field", [(0.0, 0.0, 6e-4), (4e-4, -1e-4, 3e-4)], ids=["upright", "askew"])
def test_energy_never_grows(law, hanging, field, limit):
    coils = tuple(replace(coil, dipole_limit=limit) for coil in hanging.magnetorquers)
    table = replace(hanging, magnetic_field=np.array(field), magnetorquers=coils)
    start = InitialState(
        attitude=from_rotation_vector(np.array([0.3, -0.2, 0.1])),
        rate_body=np.array([0.05, 0.1, -0.1]),
    )
    run = simulate(law, table, 40.0, start=start)
    stored = energy(table, run)
    if limit < 1.0:
        assert np.abs(run.applied["command_dipole"]).max() == limit, "they should be at their limit"
    assert np.diff(stored).max() < 1e-6 * stored[0]
    assert stored[-1] < stored[0]


def test_field_with_a_horizontal_part_damps_all_three_axes(law, hanging):
    askew = replace(hanging, magnetic_field=np.array([4e-4, 0.0, 4e-4]))
    start = InitialState(rate_body=np.array([0.03, 0.02, 0.05]))
    run = simulate(law, askew, 180.0, start=start)
    assert np.abs(run.true["rate"][-1]).max() < 2e-3


def test_machine_without_coils_or_field_is_refused(law, sads, hanging):
    with pytest.raises(ControllerError, match="by magnetorquers, and sads has none"):
        law.init(sads, 1)
    with pytest.raises(ControllerError, match="cubesat states none"):
        law.init(replace(hanging, magnetic_field=np.zeros(3)), 1)
