"""An inertia that noise carried beyond the possible comes back as the nearest rigid body."""

from dataclasses import replace

import numpy as np
import pytest

from twin.identification.identification import nearest_body
from twin.model import Machine, carried_properties, compile_model
from twin.platform import load_platform
from twin.predict.base import BaseParameters, base_parameters

SEED = 11


@pytest.fixture(scope="module")
def plate() -> Machine:
    """The bus of `sads`, hammered almost flat: about its CM, Jzz is next to Jxx + Jyy."""
    stated = load_platform("sads")
    machine = compile_model(stated)
    flat = np.diag([3.0, 9.0, 11.9999])
    about_center = bus(machine, base_parameters(machine).as_stated)
    return compile_model(replace(stated, inertia=stated.inertia - about_center + flat))


def bus(machine: Machine, entries: np.ndarray) -> np.ndarray:
    """(3, 3) inertia of the bus about its own CM, when the whole has these J and m r."""
    xx, yy, zz, xy, xz, yz = entries[:6]
    carried = carried_properties(machine.model, machine.base_body)
    mass = machine.platform.mass - carried.mass
    moment = entries[6:] - carried.center_of_mass_offset
    about_anchor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) - carried.inertia
    return about_anchor - (moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass


def draws(base: BaseParameters, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Estimates of the stated base, and their covariance."""
    rng = np.random.default_rng(SEED)
    mixed = np.eye(9) + 0.3 * rng.standard_normal((9, 9))
    sigma = np.array([0.02] * 6 + [2e-5] * 3)
    covariance = mixed @ mixed.T * np.outer(sigma, sigma)
    return rng.multivariate_normal(base.as_stated, covariance, count), covariance


def test_what_comes_back_is_a_body_and_no_farther_from_the_truth(plate):
    base = base_parameters(plate)
    estimates, covariance = draws(base, 40)
    inverse = np.linalg.inv(covariance)
    moved = 0
    for theta in estimates:
        found = nearest_body(base, theta, covariance)
        low, middle, high = np.linalg.eigvalsh(bus(plate, found.theta))
        assert low > 0.0
        assert low + middle >= high * (1.0 - 1e-6)
        before, after = theta - base.as_stated, found.theta - base.as_stated
        # nearer, but for the solver's last digits
        assert after @ inverse @ after <= before @ inverse @ before * (1.0 + 1e-3) + 1e-3
        moved += found.distance > 0.0
    assert 10 < moved < 35, "about half of them lie beyond"


def test_a_body_stays_as_it_is():
    base = base_parameters(compile_model(load_platform("sads")))
    found = nearest_body(base, base.as_stated, np.eye(9))
    assert found.distance == 0.0
    assert not found.sentence
    np.testing.assert_array_equal(found.theta, base.as_stated)


def test_noise_and_a_wrong_model_are_told_apart(plate):
    base = base_parameters(plate)
    beyond = base.as_stated + np.array([0, 0, 0.1, 0, 0, 0, 0, 0, 0])
    loose, tight = (
        nearest_body(base, beyond, np.diag(np.square([s] * 6 + [1e-5] * 3))) for s in (0.1, 0.01)
    )
    assert "the nearest one is given" in loose.sentence
    assert "not noise" not in loose.sentence
    assert "not noise" in tight.sentence


def test_a_fit_may_pass_where_no_body_is(plate):
    base = base_parameters(plate)
    beyond = base.as_stated + np.array([0, 0, 0.1, 0, 0, 0, 0, 0, 0])
    assert base.model(beyond).nv == plate.model.nv
