"""An attitude that its file gives as Euler angles: their signs and order, in those angles."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from twin.conventions.axes import ODD, SIMPLE, entries, signed_permutations
from twin.conventions.correction import (
    Correction,
    angles_of,
    as_tuple,
    attitude_of,
    right_angles,
    stated,
)
from twin.recording import Recording, Series
from twin.recording.quaternions import columns_of
from twin.units import listed

Array = NDArray[np.float64]


def angle_changes(recording: Recording) -> Iterator[Correction]:
    """Every other sign and order of the three angles of the attitude; none of a quaternion."""
    facts = stated(recording, "attitude")
    layout = str(facts.get("format") or "")
    if not layout.startswith("euler_") or "attitude" not in recording:
        return
    names = columns_of(layout)
    columns = facts.get("columns")
    if names[0] == "first" and isinstance(columns, list) and len(columns) == 3:
        names = [str(name).removeprefix("-") for name in columns]
    for axes in signed_permutations(3)[1:]:
        yield Correction(
            "attitude",
            "angles",
            _words(axes, names),
            cost=_cost(axes),
            axes=as_tuple(axes),
            sequence=layout.removeprefix("euler_").upper(),
            world_to_body=facts.get("direction") == "world_to_body",
        )


def read_angles(recording: Recording) -> Iterator[tuple[Correction | None, Series]]:
    """The attitude as read, and with every change of its angles, worked out once."""
    series, changes = recording["attitude"], list(angle_changes(recording))
    yield None, series
    if not changes:
        return
    sequence, backwards = changes[0].sequence, changes[0].world_to_body
    angles = angles_of(series.value, sequence, world_to_body=backwards)
    for change in changes:
        turned = right_angles(angles, np.array(change.axes), sequence)
        value = attitude_of(turned, sequence, world_to_body=backwards)
        yield change, replace(series, value=value)


def _cost(axes: Array) -> float:
    """One angle, or all of them, turn the other way; two columns are swapped: plain mistakes."""
    moved = int(np.sum(np.argmax(np.abs(axes), axis=1) != np.arange(3)))
    negated = int(np.sum(axes < 0.0))
    signs = {0: 0.0, 2: SIMPLE + 1.0}.get(negated, SIMPLE)
    order = {0: 0.0, 2: SIMPLE}.get(moved, SIMPLE + 2.0)
    return min(signs + order, ODD + 2.0)


def _words(axes: Array, names: tuple[str, ...] | list[str]) -> str:
    source = np.argmax(np.abs(axes), axis=1)
    moved = [names[i] for i, j in enumerate(source) if i != j]
    negated = [names[i] for i, row in enumerate(axes) if row.min() < 0.0]
    if len(negated) == 3 and not moved:
        return f"the attitude's {listed(names)} turn clockwise, read as counterclockwise"
    if not moved:
        sign = "have the wrong signs" if len(negated) > 1 else "has the wrong sign"
        return f"the attitude's {listed(negated)} {sign}"
    if not negated and len(moved) == 2:
        return f"the attitude's {listed(moved)} are swapped"
    return "the attitude's angles stand in another order: " + ", ".join(
        f"{name} is read as {entry}"
        for name, entry in zip(names, entries(axes, names), strict=True)
        if name != entry
    )
