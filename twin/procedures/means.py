"""What a machine can balance itself with: masses within their travel, and something that damps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.controller import AnyController, load_controller
from twin.controller.masses import Masses
from twin.errors import ControllerError
from twin.platform import Platform
from twin.rotation import vertical_body
from twin.signals import Estimate

Array = NDArray[np.float64]

SLIDE = 100.0
"""In which masses that right a leaning body would go from end to end at most [s]."""


def damper(platform: Platform, rate: float) -> AnyController:
    """A law that takes the body's rate away, with a torque of rate [1/s] times a mean J a rad/s.

    Raises:
        ControllerError: nothing on the machine damps.
    """
    gain = rate * mean_inertia(platform)
    held = {"proportional": 0.0, "derivative": gain}
    if platform.magnetorquers and np.any(platform.magnetic_field):
        return load_controller("magnetic_damping", {"derivative": gain})
    if len(platform.gimbals) >= 3:
        law = "vscmg_pd" if platform.wheels else "cmg_pd"
        return load_controller(law, held)
    if platform.wheels:
        return load_controller("quaternion_pd", held)
    raise ControllerError(
        f"nothing on {platform.name} damps its swinging; balancing needs magnetorquers in a field, "
        "wheels or gyros"
    )


def mean_inertia(platform: Platform) -> float:
    """Of the principal moments as stated [kg m^2]."""
    return float(np.trace(platform.inertia)) / 3.0


@dataclass(frozen=True)
class Reach:
    """What the masses of a machine can do about its CM."""

    platform: Platform
    masses: Masses
    slides: Array
    """(stages, 3) mass moment per position [kg]."""

    @classmethod
    def of(cls, platform: Platform) -> "Reach":
        """Of its stages.

        Raises:
            ControllerError: they do not move the CM in all three directions.
        """
        masses = Masses.of(platform, "balancing")
        slides = np.array([stage.mass * stage.axis for stage in platform.stages])
        if np.linalg.matrix_rank(slides) < 3:
            raise ControllerError(
                f"balancing moves the CM in all three directions, but the {len(slides)} stages of "
                f"{platform.name} do not"
            )
        return cls(platform, masses, slides)

    def moment(self, positions: Array) -> Array:
        """(n, 3) what stage positions (n, stages) add to m r [kg m, body]."""
        return np.einsum("ns,si->ni", positions, self.slides)

    def undone_by(self, shares: Array) -> Array:
        """(n, 3) m r at stage position 0 [kg m] that masses undo at those parts of their travel.

        Args:
            shares: (n, stages), -1 to 1 about the middle of each travel.
        """
        low, high = self.masses.travel
        return -self.moment(0.5 * (low + high) + 0.5 * (high - low) * shares)

    def lowest(self, positions: Array) -> Array:
        """(n, stages) from `positions`, with the CM lowered as far as the travel lets it."""
        down = np.zeros((len(positions), 3))
        down[:, 2] = -1.0
        return self.along(positions, down)

    @property
    def depth(self) -> float:
        """How far the masses can lower m r from their zeros [kg m]."""
        zero = np.zeros((1, len(self.slides)))
        return -float(self.moment(self.lowest(zero))[0, 2])

    def along(self, positions: Array, moment: Array) -> Array:
        """(n, stages) how far stages can go from `positions` in the direction of `moment` (n, 3).

        All of them together, until the first is at the end of its travel.
        """
        low, high = self.masses.travel
        way = self.masses.positions(moment)
        room = np.where(way > 0.0, high - positions, low - positions)
        share = np.where(
            np.abs(way) > 1e-12 * np.abs(way).max(),
            room / np.where(way == 0.0, 1.0, way),
            np.inf,
        )
        return positions + way * np.min(share, axis=1, keepdims=True)

    def beyond(self, positions: Array) -> str:
        """A sentence for positions (stages,) that a travel does not hold; empty where all do."""
        for stage, position in zip(self.platform.stages, positions.tolist(), strict=True):
            low, high = stage.travel
            if not low <= position <= high:
                return (
                    f"{stage.name} would have to stand at {position * 1e3:.4g} mm, and its travel "
                    f"is {low * 1e3:.4g} to {high * 1e3:.4g} mm"
                )
        return ""

    def uphill(self, estimate: Estimate, seconds: float) -> Array:
        """(n, stages) steps of a leaning body's masses away from where it leans to.

        For `seconds`, so slowly that the body can follow before they are too far.
        """
        up = vertical_body(estimate.attitude)
        stop = self.platform.pitch_stop
        if stop is not None:
            up = np.einsum("ni,i->n", up, stop.axis)[:, None] * stop.axis
        aside = up * np.array([1.0, 1.0, 0.0])
        way = self.masses.positions(aside)
        low, high = self.masses.travel
        fastest = np.minimum(0.5 * self.masses.speed, (high - low) / SLIDE)
        pace = np.max(np.abs(way) / fastest, axis=1, keepdims=True)
        return np.where(pace > 0.0, seconds * way / np.maximum(pace, 1e-300), 0.0)
