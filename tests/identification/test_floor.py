"""The base of a machine on a floor: mass, Jzz and m r, from logs of drawn machines."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2

from twin.api import fly
from twin.identification import identify
from twin.platform import Platform, load_platform
from twin.report.outcomes import identified

SEEDS = 5


def drawn(platform: Platform, rng: np.random.Generator) -> Platform:
    """A machine a tenth off what is stated, its centre of mass elsewhere."""
    return replace(
        platform,
        mass=platform.mass * rng.uniform(0.9, 1.1),
        inertia=platform.inertia * rng.uniform(0.8, 1.2),
        center_of_mass_offset=np.array([*rng.uniform(-0.2, 0.2, 2), 0.0]),
    )


def flown(platform: Platform, seed: int):
    run = fly(
        platform,
        "thruster_doublets",
        duration=20.0,
        velocity=(0.02, 0.01, 0.0),
        rate=(0.0, 0.0, 0.1),
        seed=seed,
    )
    return run.recording.without_truth()


def test_mass_inertia_and_mass_moment_of_drawn_machines_lie_in_their_intervals(drawn_seed: int):
    stated, distance, parameters = load_platform("kentucky_planar"), 0.0, 0
    for index in range(SEEDS):
        rng = np.random.default_rng([drawn_seed, index])
        machine = drawn(stated, rng)
        found = identify([flown(machine, int(rng.integers(2**31)))], stated)
        assert found.base.names == ("mass", "Jzz", "mr_x", "mr_y")
        true = np.array([machine.mass, machine.inertia[2, 2], *machine.center_of_mass_offset[:2]])
        error = found.theta - true
        distance += float(error @ np.linalg.solve(found.covariance, error))
        parameters += len(true)
        assert found.half_widths[0] < 2e-3 * machine.mass, "the mass hardly shows"
    print(f"chi-square {distance:.1f} of {parameters}, seed {drawn_seed}")
    assert distance < chi2.ppf(0.999, parameters)


def test_a_stated_deviation_of_the_mass_holds_it_where_thrust_is_not_as_stated(drawn_seed: int):
    stated = load_platform("kentucky_planar")
    run = fly(
        stated, "thruster_doublets", duration=20.0, effects="thruster_gain=-0.1", seed=drawn_seed
    )
    log = run.recording.without_truth()
    free = identify([log], stated)
    assert free.theta[0] == pytest.approx(stated.mass / 0.9, rel=5e-3), "it takes the gain"
    held = identify([log], replace(stated, mass_sd=1e-3))
    assert held.theta[0] == pytest.approx(stated.mass, abs=5e-3)


def test_it_is_printed_as_what_a_machine_on_a_floor_has(drawn_seed: int):
    stated = load_platform("kentucky_planar")
    found = identify([flown(stated, drawn_seed)], stated)
    text = "\n".join(identified(found))
    assert "mass  23." in text
    assert "kg m^2 about the vertical" in text
    assert "mm of 23." in text
    assert "tilt" not in text
    document = found.document()["base"]
    # one interval in twenty misses, of twice its width one in ten thousand
    half = 0.5 * (document["mass"]["high"] - document["mass"]["low"])
    middle = document["mass"]["low"] + half
    assert abs(stated.mass - middle) < 2.0 * half
