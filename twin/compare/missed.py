"""What an account misses of each stream, in its SI unit."""

from dataclasses import dataclass

import numpy as np

from twin.compare.account import Account
from twin.predict.path.segments import Segment

STANDS_OUT = 10.0
"""A stretch is disturbed when its residual is so many times the median stretch's."""


@dataclass(frozen=True)
class StreamError:
    """What a model misses of one stream, in its SI unit."""

    stream: str
    unit: str
    noise: float
    """1 sigma a sample, over the columns."""
    noise_stated: bool
    """By the log; else estimated from its data."""
    rms: float
    typical: float
    """The rms of the median segment: what is missed where nothing special happens."""
    worst: float
    worst_time: float
    """[s]."""
    chi2_per_sample: float


def stream_errors(account: Account) -> list[StreamError]:
    """What an account misses, stream by stream."""
    body = account.problem.bodies[0]
    errors: list[StreamError] = []
    for output, left in zip(body.outputs, account.left[0], strict=True):
        values = left * output.sigma
        size = np.linalg.norm(values, axis=1)
        worst = int(np.argmax(size))
        counts = np.bincount(output.segment, minlength=body.grid.segments)
        squares = np.bincount(
            output.segment, np.mean(np.square(values), axis=1), minlength=body.grid.segments
        )
        inside = counts > 0
        errors.append(
            StreamError(
                output.stream,
                output.unit,
                float(np.sqrt(np.mean(np.square(output.noise)))),
                output.stated,
                float(np.sqrt(np.mean(np.square(values)))),
                float(np.median(np.sqrt(squares[inside] / counts[inside]))),
                float(size[worst]),
                float(output.time[worst]),
                float(np.mean(np.square(left))),
            )
        )
    return errors


def disturbed(account: Account) -> list[Segment]:
    """Stretches whose residual stands out: something acted that no symptom knows."""
    body = account.problem.bodies[0]
    grid = body.grid
    squares, counts = np.zeros((2, grid.segments))
    for output, left in zip(body.outputs, account.left[0], strict=True):
        squares += np.bincount(
            output.segment, np.sum(np.square(left), axis=1), minlength=grid.segments
        )
        counts += left.shape[1] * np.bincount(output.segment, minlength=grid.segments)
    sizes = squares / np.maximum(counts, 1.0)
    limit = STANDS_OUT**2 * max(float(np.median(sizes)), 1.0)
    return [
        Segment(float(start), float(start) + grid.length)
        for start, size in zip(grid.starts, sizes, strict=True)
        if size > limit
    ]
