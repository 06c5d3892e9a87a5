"""Wheels that nothing drives lag behind the body and tell nothing of their unit."""

from dataclasses import replace

import numpy as np

from papers.flown import flown
from twin.controller import load_controller
from twin.conventions import check_conventions
from twin.diagnosis.baseline import baseline_of
from twin.plant.initial import InitialState
from twin.platform import load_platform

SEED = 20261123
FINE = 1e-4
"""[rad/s, rad] of gyro and attitude."""


def test_idle_wheels_are_not_accused_of_their_unit_where_inertia_is_off():
    rng = np.random.default_rng(SEED)
    shipped = load_platform("sads")
    sensors = {
        name: replace(one, noise=np.full_like(one.noise, FINE))
        if name in ("gyro", "attitude")
        else one
        for name, one in shipped.sensors.items()
    }
    hanging = replace(shipped, sensors=sensors, center_of_mass_offset=np.array([0.0, 0.0, -0.4]))
    start = InitialState(rate_body=np.radians(rng.uniform(-14.0, 14.0, 3) * [1.0, 0.3, 0.05]))
    (log,) = flown(
        hanging, load_controller("free_float"), 40.0, start=start, seed=SEED, record=True
    ).recordings
    off = 1.0 + rng.uniform(0.03, 0.05) * rng.choice([-1.0, 1.0])
    print(f"seed {SEED}: inertia believed {off:.3f} times as large as it is")
    believed = replace(hanging, inertia=off * hanging.inertia)
    assert check_conventions(log.without_truth(), believed) == []
    assert baseline_of([log.without_truth()], believed).converged
