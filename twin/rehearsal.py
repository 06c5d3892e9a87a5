"""A flight flown in simulation before the machine flies it: how far it leans at worst.

Where a machine's CM is, is known to an interval. A motion that is harmless with the CM in the
middle of it may bring the table to its stop with the CM in a corner, so all corners of the 95 %
box are flown, under the same law and the same reference.
"""

import json
from collections.abc import Mapping
from itertools import product
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from twin.clock import SimulatedClock
from twin.errors import SafetyError, UsageError
from twin.flight import Flight
from twin.loop import Ended, fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform
from twin.signals import Tick
from twin.stop import Stopped

Array = NDArray[np.float64]


def identified_box(file: Path) -> tuple[Array, Array]:
    """Lowest and highest m r (3,) [kg m] of what `twin identify --json` wrote.

    Raises:
        UsageError: it cannot be read, or is something else.
    """
    try:
        document: Any = json.loads(file.read_text(encoding="utf-8"))
        result = cast(Mapping[str, Any], document["base"]["center_of_mass_offset"])
        low, high = (np.array(result[end], dtype=np.float64) for end in ("low", "high"))
    except (OSError, ValueError, KeyError, TypeError) as problem:
        raise UsageError(
            f"{file} tells no 95 % set of the CM ({type(problem).__name__}: {problem}); give what "
            "`twin identify LOG --json` wrote"
        ) from problem
    if low.shape != (3,) or high.shape != (3,) or not np.isfinite([low, high]).all():
        raise UsageError(f"{file}: the CM is not known in all three axes; identify it anew")
    return low, high


def worst_lean(flight: Flight, box: tuple[Array, Array]) -> tuple[float, Array]:
    """The largest lean [rad] over the corners of a box of m r, and that corner (3,) [kg m].

    Raises:
        SafetyError: a corner was not flown to its end.
        Stopped: a stop was requested.
    """
    corners = np.array(list(product(*zip(*box, strict=True))))
    platform = flight.platform
    lean = _Lean(platform, len(corners))
    with SimulatedPlant(
        platform,
        runs=range(len(corners)),
        initial=InitialState(center_of_mass_offset=corners),
    ) as plant:
        outcome = fly(
            plant,
            flight.estimator,
            flight.controller,
            flight.reference,
            SimulatedClock(),
            duration=flight.duration,
            observers=[lean],
        )
    if outcome.asked:
        # the loop takes a stop for a good end, but whoever asks for one does not ask to fly
        raise Stopped(outcome.asked)
    if outcome.ended is not Ended.done:
        why = "; ".join(dict.fromkeys(outcome.stopped.values())) or outcome.reason
        raise SafetyError(
            f"not flown: in simulation, at the corners of the 95 % set, it did not come to its "
            f"end: {why}",
            "take a smaller amplitude or a shorter time, or correct the law",
        )
    worst = int(np.argmax(lean.most))
    return float(lean.most[worst]), corners[worst]


def check_lean(flight: Flight, box: tuple[Array, Array]) -> str:
    """Hold the worst corner against where the guard of a machine on its bench cuts out.

    Args:
        flight: on a bench.
        box: lowest and highest m r (3,) [kg m].

    Returns:
        A sentence with the largest lean.

    Raises:
        SafetyError: it would be cut out, or was not flown to its end in simulation.
        Stopped: a stop was requested meanwhile.
    """
    assert flight.bench is not None
    most, corner = worst_lean(flight, box)
    cutout = flight.bench.setup.guard.tilt_cutout
    where = ", ".join(f"{1e6 * r:.3g}" for r in corner / flight.platform.mass)
    told = (
        f"in simulation, at the worst corner of the 95 % set, with the CM ({where}) um from the "
        f"CR, it leans by up to {np.degrees(most):.1f} of {np.degrees(cutout):.1f} deg"
    )
    # turned round, so that a lean that is no number does not pass
    if not most <= cutout:
        raise SafetyError(
            f"not flown: {told}", "take a smaller amplitude or a shorter time, or balance it first"
        )
    return told


class _Lean:
    """Observer: the largest lean of each run [rad]."""

    def __init__(self, platform: Platform, n: int) -> None:
        self._platform = platform
        self.most = np.zeros(n)

    def collect(self, tick: Tick) -> None:
        attitude = tick.truth["truth_attitude"].value[:, -1]
        self.most = np.maximum(self.most, self._platform.lean(attitude))
