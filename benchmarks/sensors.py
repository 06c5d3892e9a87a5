"""Sensors without fault or faults to compute, for the cost of a control law alone."""

from dataclasses import replace

import numpy as np

from twin.platform import Platform, Sensor


def perfect(platform: Platform) -> Platform:
    """The platform with nothing but a faultless gyro and attitude, once a control tick."""
    sensors = {
        name: Sensor(name, platform.control_rate, noise=np.zeros(3), bias=np.zeros(3))
        for name in ("gyro", "attitude")
    }
    return replace(platform, sensors=sensors)
