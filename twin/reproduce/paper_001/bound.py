"""The Cramer-Rao bound of an offset: how a flight answers to all that is unknown of it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.estimators import Passthrough
from twin.plant.initial import InitialState
from twin.platform import Platform
from twin.reproduce.paper_001.flights import FlownRuns, exact_sensors, flown
from twin.rotation import conjugate, from_rotation_vector, multiply, to_rotation_vector

Array = NDArray[np.float64]

STEPS = {"turn": 1e-4, "rate": 1e-5, "wheels": 1e-2, "stages": 1e-6}
"""Of central differences [rad, rad/s, rad/s, m]."""


def offset_bound(platform: Platform, start: InitialState, duration: float) -> Array:
    """(3, 3) least covariance of m r [kg^2 m^2] after a free flight.

    Unknown are m r, the start (attitude, rate, wheel speeds) and the gyro's bias, this one within
    what the platform states; known are J and that nothing else acts. All samples of gyro, attitude
    and wheel speed count, each with the noise that the platform states. m r is changed by moving
    the stages: a micrometre moves J by parts in 10^7.

    Args:
        platform: three stages, with axes that span space.
        start: the same for all runs.
        duration: [s].
    """
    wheels, stages = len(platform.wheels), len(platform.stages)
    sizes = np.repeat(list(STEPS.values()), (3, 3, wheels, stages))
    shift = np.concatenate([np.diag(sizes), -np.diag(sizes)])
    turn, rate, spin, place = np.split(shift, np.cumsum([3, 3, wheels]), axis=1)
    moved = replace(
        start,
        attitude=multiply(start.attitude, from_rotation_vector(turn)),
        rate_body=start.rate_body + rate,
        wheel_speed=start.wheel_speeds(platform) + spin,
        stage_position=place,
    )
    exact = exact_sensors(replace(platform, effects=()))
    run = flown(exact, "free_float", Passthrough(), moved, duration, seeds=len(shift))
    streams = _answers(run, sizes)
    # the gyro's bias, after the others, is in its own reading only
    streams["gyro"][:, :, len(sizes) :] = np.eye(3)
    information = np.zeros((len(sizes) + 3, len(sizes) + 3))
    bias = platform.sensors["gyro"].bias
    information[len(sizes) :, len(sizes) :] = np.diag(1.0 / np.square(bias))
    for stream, answer in streams.items():
        sensor = platform.sensors[stream]
        weight = sensor.rate * platform.tick / np.square(sensor.noise)
        information += np.einsum("mki,k,mkj->ij", answer, weight, answer)
    scale = 1.0 / np.sqrt(np.diag(information))
    covariance = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    by_stages = covariance[len(sizes) - stages : len(sizes), len(sizes) - stages : len(sizes)]
    slides = np.array([stage.mass * stage.axis for stage in platform.stages])
    return slides.T @ by_stages @ slides


def _answers(run: FlownRuns, sizes: Array) -> dict[str, Array]:
    """d reading / d unknown of each stream, (m, k, unknowns + 3)."""
    count = len(sizes)
    up, down = (
        {name: values[1:, part] for name, values in run.true.items()}
        for part in (slice(0, count), slice(count, None))
    )
    apart = {
        "attitude": to_rotation_vector(multiply(conjugate(down["attitude"]), up["attitude"])),
        "gyro": up["rate"] - down["rate"],
        "wheel_speed": up["wheel_speed"] - down["wheel_speed"],
    }
    answers = {}
    for stream, difference in apart.items():
        slope = (difference / (2.0 * sizes[:, None])).transpose(0, 2, 1)
        answers[stream] = np.concatenate([slope, np.zeros((*slope.shape[:2], 3))], axis=2)
    return answers
