"""Errors of sensors that the catalogue has no name for: products of what each should show."""

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.diagnose.law import Law
from twin.effects.on_sensor import levels_of, product_of, rates_of, shown_by, units_of
from twin.predict.body import Body
from twin.predict.effects.perturbation import Perturbation
from twin.predict.sensors.outputs import Output
from twin.signals import STREAMS

Array = NDArray[np.float64]


def sensor_laws(bodies: Sequence[Body]) -> Iterator[Law]:
    """Of every sensor that a prediction is held against; not of what follows from commands."""
    outputs = {output.stream: output for body in reversed(bodies) for output in body.outputs}
    for output in outputs.values():
        if output.told is not None or output.course is not None:
            continue
        units = units_of(output.stream, output.columns)
        for index, factors in _products(output):
            yield _law(output, index, factors, units)


def _products(output: Output) -> Iterator[tuple[int, tuple[str, ...]]]:
    """Column, and the factors of what it may be off by."""
    stream, columns = output.stream, output.columns
    # one column a part: what one wheel does shows in no other's reading
    shared = bool(STREAMS[stream].columns)
    levels, rates = levels_of(stream, columns), rates_of(stream, columns)
    for index, (level, rate) in enumerate(zip(levels, rates, strict=True)):
        yield from ((index, factors) for factors in ((), ("time",), (rate,), (level, level)))
        yield from ((index, (other,)) for other in (levels if shared else (level,)))


def _law(output: Output, index: int, factors: tuple[str, ...], units: dict[str, str]) -> Law:
    stream, columns = output.stream, output.columns
    below = [f"({units[name]})^-1" for name in factors if units[name]]
    unit = " ".join(["rad" if stream == "attitude" else STREAMS[stream].unit, *below])

    def error(measured: Output, truth: Array) -> Array:
        time = np.broadcast_to(measured.time - measured.time[0], truth.shape[:2])
        found = np.zeros((len(truth), *measured.slot.shape))
        found[..., index] = product_of(shown_by(stream, columns, time, truth), factors)
        return found

    name = f"{stream}_{columns[index]} ~ {' '.join(factors) or '1'}"
    return Law(
        stream, columns[index], factors, unit, Perturbation(name, unit, stream=stream, shown=error)
    )
