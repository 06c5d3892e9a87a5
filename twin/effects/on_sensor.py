"""A sensor's error in proportion to products of what it should show: a law without a better name.

What a diagnosis finds where the catalogue has no cause for it, and what it writes as an effect.
"""

import abc
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from twin import rotation
from twin.effects.effect import Domain
from twin.effects.on_series import Array, Live, Order, SeriesEffect, with_value
from twin.platform import Platform
from twin.signals import STREAMS, Samples

UNDONE = 3
"""Rounds in which the truth is sought; each leaves the error's share of what was left."""


@dataclass(frozen=True)
class SensorLaw(SeriesEffect, abc.ABC):
    """Shows more than the truth by a sum of products of the truth; of an attitude, by a turn."""

    domain = Domain.sensor
    order = Order.scale
    products: ClassVar[tuple[tuple[str, tuple[str, ...]], ...]]
    """Of each parameter: the column that is off, and the factors, named as `shown_by` has them."""

    def apply(self, samples: Samples, platform: Platform) -> Samples:
        return self.live(platform)(samples)

    def live(self, platform: Platform) -> Live:
        begin: Array | None = None
        before: Samples | None = None

        def follow(samples: Samples) -> Samples:
            nonlocal begin, before
            begin = samples.time[:, :1] if begin is None else begin
            whole = samples if before is None else _joined(before, samples)
            before = Samples(whole.value[:, -1:], whole.time[:, -1:], whole.valid[:, -1:])
            error = self._error(whole, begin, platform)[:, -samples.value.shape[1] :]
            return with_value(samples, shown(self.stream, samples.value, error))

        return follow

    def undo(self, samples: Samples, platform: Platform) -> Samples:
        truth = samples
        for _ in range(UNDONE):
            error = self._error(truth, truth.time[:, :1], platform)
            truth = with_value(samples, shown(self.stream, samples.value, -error))
        return truth

    def _error(self, samples: Samples, begin: Array, platform: Platform) -> Array:
        columns = columns_in_error(self.stream, platform.columns(self.stream))
        known = shown_by(self.stream, columns, samples.time - begin, samples.value)
        error = np.zeros((*samples.time.shape, len(columns)))
        for size, (column, factors) in zip(self.values.tolist(), self.products, strict=True):
            error[..., columns.index(column)] += size * product_of(known, factors)
        return error


def shown(stream: str, value: Array, error: Array) -> Array:
    """A stream's values (..., k), or (..., 4) of an attitude, with an error (..., k)."""
    if stream == "attitude":
        return rotation.multiply(value, rotation.from_rotation_vector(error))
    return value + error


def columns_in_error(stream: str, columns: Sequence[str]) -> tuple[str, ...]:
    """What the components of an error are called: an attitude's are turns about body axes."""
    return ("x", "y", "z") if stream == "attitude" else tuple(columns)


def shown_by(stream: str, columns: Sequence[str], time: Array, value: Array) -> dict[str, Array]:
    """What an error may depend on, by name: (n, m) each.

    Args:
        stream: of a sensor.
        columns: as `columns_in_error` has them.
        time: (n, m) since the log began [s].
        value: (n, m, k) that it should show; (n, m, 4) of an attitude.

    Rates look back: what a law commands at an instant answers to the noise of what it read then.
    """
    step = np.maximum(np.diff(time), 1e-9)[..., None]
    if stream == "attitude":
        turn = rotation.multiply(rotation.conjugate(value[:, :-1]), value[:, 1:])
        change, level = rotation.to_rotation_vector(turn) / step, rotation.vertical_body(value)
        names = [f"up_{column}" for column in columns], [f"rate_{column}" for column in columns]
    else:
        change, level = np.diff(value, axis=1) / step, value
        names = (
            [f"{stream}_{column}" for column in columns],
            [f"rate_of_{stream}_{column}" for column in columns],
        )
    rates = np.concatenate([np.zeros_like(change[:, :1]), change], axis=1)
    result = {"time": time}
    for called, values in zip(names, (level, rates), strict=True):
        result |= {name: values[..., i] for i, name in enumerate(called)}
    return result


def levels_of(stream: str, columns: Sequence[str]) -> list[str]:
    """What a stream shows, by name; of an attitude, where up is."""
    return [f"up_{column}" if stream == "attitude" else f"{stream}_{column}" for column in columns]


def rates_of(stream: str, columns: Sequence[str]) -> list[str]:
    """How fast that changes, by name; of an attitude, how fast it turns."""
    return [
        f"rate_{column}" if stream == "attitude" else f"rate_of_{stream}_{column}"
        for column in columns
    ]


def units_of(stream: str, columns: Sequence[str]) -> dict[str, str]:
    """Of what `shown_by` names; empty of numbers without one."""
    turned = stream == "attitude"
    unit = "" if turned else STREAMS[stream].unit
    rate = "rad/s" if turned else f"{unit} s^-1"
    return {
        "time": "s",
        **dict.fromkeys(levels_of(stream, columns), unit),
        **dict.fromkeys(rates_of(stream, columns), rate),
    }


def product_of(known: Mapping[str, Array], factors: Sequence[str]) -> Array:
    """(n, m)."""
    result = np.ones_like(known["time"])
    for name in factors:
        result = result * known[name]
    return result


def _joined(before: Samples, after: Samples) -> Samples:
    return Samples(
        np.concatenate([before.value, after.value], axis=1),
        np.concatenate([before.time, after.time], axis=1),
        np.concatenate([before.valid, after.valid], axis=1),
    )
