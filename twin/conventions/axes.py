"""Signed permutations: all the ways in which axes can be swapped, flipped and turned."""

from collections.abc import Iterator, Sequence
from functools import cache
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray

from twin.units import listed

Array = NDArray[np.float64]

SIMPLE = 6.0
"""What one plain mistake costs a hypothesis [nats]: one in four hundred logs has it."""
LATE = 9.0
"""What a clock that is off costs, a plain mistake too: beside a latency there are twenty times as
many lags that may fit by chance, and one of a whole period does as well as none."""
ODD = 12.0
"""What a rarer one costs, as much as two plain ones."""

MIRROR = 3.5
"""What a left-handed sensor of three axes costs beside that: nobody builds one, so that it is named
only where nothing right-handed fits, or with what fits as well."""


@cache
def signed_permutations(size: int) -> Array:
    """(count, size, size) matrices S: right = S read. The identity stands first.

    All 48 of three axes. Of more than three (wheels), those that swap two or flip one or all.
    """
    identity = np.eye(size)
    if size <= 3:
        orders, signs = permutations(range(size)), list(product((1.0, -1.0), repeat=size))
        return np.array([np.diag(s) @ identity[list(o)] for o in orders for s in signs]) + 0.0
    flips = [identity - 2.0 * np.diag(row) for row in identity]
    swaps = [identity[_swapped(size, i, j)] for i in range(size) for j in range(i)]
    return np.array([identity, -identity, *flips, *swaps])


def _swapped(size: int, i: int, j: int) -> list[int]:
    order = list(range(size))
    order[i], order[j] = j, i
    return order


def cost_of(axes: Array) -> float:
    """How unusual a mistake is [nats]: one axis flipped or two swapped are the plain ones."""
    source = np.argmax(np.abs(axes), axis=1)
    moved = int(np.sum(source != np.arange(len(axes))))
    flipped = int(np.sum(axes < 0.0))
    if moved == 0:
        return {0: 0.0, len(axes): SIMPLE + 1.0, 1: SIMPLE}.get(flipped, SIMPLE + 2.0)
    if flipped == 0:
        return SIMPLE if moved == 2 else SIMPLE + 2.0
    quarter_turn = moved == 2 and flipped == 1
    return SIMPLE + 2.0 if quarter_turn else ODD


def words_for(stream: str, axes: Array, names: Sequence[str]) -> str:
    """What is wrong with a stream whose right values are `axes` times those read."""
    source = np.argmax(np.abs(axes), axis=1)
    moved = [i for i, j in enumerate(source) if i != j]
    flipped = [i for i, row in enumerate(axes) if row.min() < 0.0]
    if not moved:
        if len(flipped) == len(axes) > 1:
            return f"every axis of {stream} points the other way"
        if len(axes) == 1:
            return f"{stream} has the wrong sign"
        which = listed([names[i] for i in flipped])
        if len(flipped) == 1:
            return f"{stream}'s {which} axis points the other way"
        return f"{stream}'s {which} axes point the other way"
    if not flipped and len(moved) == 2:
        return f"{stream}'s {listed([names[i] for i in moved])} axes are swapped"
    return f"{stream}'s axes are turned: " + ", ".join(
        f"{name} is read as {entry}"
        for name, entry in zip(names, entries(axes, names), strict=True)
        if name != entry
    )


def entries(axes: Array, names: Sequence[str]) -> list[str]:
    """Which column, and with which sign, is each axis: ["y", "-x", "z"]."""
    return ["-" * int(row.min() < 0.0) + names[int(np.argmax(np.abs(row)))] for row in axes]


def quaternion_matrices() -> Iterator[tuple[str, Array]]:
    """(name, 4 x 4) ways in which a quaternion can be misread: right = A read, up to its sign.

    `xyzw`: its scalar stands last and was read as first; `wxyz`: the reverse; `inverse`: it turns
    the other way; `axes`: its vector part is in other axes.
    """
    scalar_last = np.eye(4)[[3, 0, 1, 2]]
    inverse = np.diag([1.0, -1.0, -1.0, -1.0])
    yield "", np.eye(4)
    yield "xyzw", scalar_last
    yield "wxyz", scalar_last.T
    yield "inverse", inverse
    yield "xyzw inverse", inverse @ scalar_last
    yield "wxyz inverse", inverse @ scalar_last.T
    for axes in signed_permutations(3)[1:]:
        if (axes != -np.eye(3)).any():
            yield "axes", np.block([[np.ones((1, 1)), np.zeros((1, 3))], [np.zeros((3, 1)), axes]])
