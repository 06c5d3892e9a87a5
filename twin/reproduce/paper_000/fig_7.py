"""Fig. 7: singular states of three gyros, and the skew whose sphere without any is the largest.

In a singular state the array cannot give a torque along some u: each rotor then turns its axis as
far along u, or against it, as its gimbal allows (G. Margulies, J. N. Aubrun, Geometric theory of
single-gimbal control moment gyro systems, 1978),
    h(u, s) = sum s_i (u - (u . g_i) g_i) / |u - (u . g_i) g_i|,  s_i = +-1.
The sphere is as large as the smallest |h| over u and s.
"""

from itertools import product

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.optimize import minimize, minimize_scalar

from twin.platform import Platform, load_platform
from twin.report.style import FIGURE, PALETTE, SOFT, svg
from twin.reproduce.part import Computed, Ours, PaperPart, Say
from twin.rotation import from_rotation_vector, rotate

Array = NDArray[np.float64]

SIGNS = np.array([(1.0, *rest) for rest in product((1.0, -1.0), repeat=2)])
"""Of the three gyros; those with all signs turned are the same states from behind."""
SKEWS = (60.0, 120.0)
"""[deg], between which the best is sought."""
COARSE = 60
"""Directions to each quarter turn of the first search."""


def compute(say: Say) -> Computed:
    """Closed form, refined numerically."""
    machine = load_platform("tas2")
    say("the best skew")
    skews = np.linspace(*SKEWS, 61)
    radii = np.array([sphere(gimbal_axes(machine, skew)) for skew in skews])
    near = float(skews[np.argmax(radii)])
    best = minimize_scalar(
        lambda skew: -sphere(gimbal_axes(machine, float(skew))),
        bounds=(near - 1.0, near + 1.0),
        method="bounded",
        options={"xatol": 1e-3},
    )
    skew, radius = float(best.x), sphere(gimbal_axes(machine, 90.0))
    others = ", ".join(
        f"{sphere(gimbal_axes(machine, other)):.3f} at {other:g}" for other in (70.0, 85.0, 95.0)
    )
    say("the surface")
    rows = {
        "000.fig7.best_skew": Ours(skew, note=f"A sphere of {-float(best.fun):.4f} gyros."),
        "000.fig7.sphere": Ours(radius, note=f"At 90 deg; {others} deg."),
    }
    axes = gimbal_axes(machine, 90.0)
    figures = {
        "Fig. 7: singular surface at a skew of 90 deg, in units of one gyro's momentum: the outer "
        "one, and the one that encloses the sphere": _surface(axes),
        "Radius of the sphere without singular states over the skew": _radii(skews, radii),
    }
    return Computed(rows, figures)


def gimbal_axes(machine: Platform, skew: float) -> Array:
    """(3, 3) g_i of the array at a skew [deg]: each turned about its rotor's axis at home."""
    turn = np.radians(skew - 90.0)
    spin = {rotor.gimbal: rotor.axis for rotor in machine.rotors}
    return np.array(
        [rotate(from_rotation_vector(turn * spin[g.name]), g.axis) for g in machine.gimbals]
    )


def momenta(axes: Array, along: Array) -> Array:
    """h(u, s) of directions (n, 3), shape (n, signs, 3), in units of one gyro's momentum.

    Along a gimbal's axis its rotor may stand anywhere; the directions round about cover that.
    """
    across = along[:, None, :] - np.einsum("ni,gi->ng", along, axes)[..., None] * axes
    size = np.linalg.norm(across, axis=2, keepdims=True)
    rotors = across / np.maximum(size, 1e-12)
    return np.einsum("sg,ngi->nsi", SIGNS, rotors)


def sphere(axes: Array) -> float:
    """The smallest |h| of a singular state, in units of one gyro's momentum."""

    def size(angles: Array) -> float:
        return float(np.linalg.norm(momenta(axes, _directions(angles[None])), axis=2).min())

    polar, around = np.meshgrid(
        np.linspace(1e-3, np.pi - 1e-3, 2 * COARSE), np.linspace(0.0, 2.0 * np.pi, 4 * COARSE)
    )
    grid = np.stack([polar.ravel(), around.ravel()], axis=1)
    sizes = np.linalg.norm(momenta(axes, _directions(grid)), axis=2).min(axis=1)
    starts = grid[np.argsort(sizes)[:5]]
    options = {"xatol": 1e-9, "fatol": 1e-12, "maxiter": 400}
    result = [minimize(size, start, method="Nelder-Mead", options=options).fun for start in starts]
    return float(min(*result, sizes.min()))


def _directions(angles: Array) -> Array:
    """(n, 3) from (n, 2) polar and azimuth."""
    polar, around = angles[:, 0], angles[:, 1]
    across = np.sin(polar)
    return np.stack([across * np.cos(around), across * np.sin(around), np.cos(polar)], axis=1)


def _surface(axes: Array) -> str:
    polar, around = np.meshgrid(np.linspace(0.01, np.pi - 0.01, 24), np.linspace(0, 2 * np.pi, 48))
    along = _directions(np.stack([polar.ravel(), around.ravel()], axis=1))
    result = momenta(axes, along)
    inner = int(np.argmin(np.linalg.norm(result, axis=2).min(axis=0)))
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 4.6))
        for place, sign in enumerate((0, inner)):
            panel = figure.add_subplot(1, 2, place + 1, projection="3d")
            x, y, z = result[:, sign].T.reshape(3, *polar.shape)
            panel.plot_wireframe(x, y, z, color=PALETTE[place], lw=0.4)
            for name in "xyz":
                getattr(panel, f"set_{name}label")(f"h_{name}")
                getattr(panel, f"set_{name}lim")(-3.0, 3.0)
        return svg(figure)


def _radii(skews: Array, radii: Array) -> str:
    with mpl.rc_context(FIGURE):
        figure = Figure(figsize=(9.6, 3.2))
        panel = figure.subplots()
        panel.plot(skews, radii, color=PALETTE[0])
        panel.axvline(90.0, color=SOFT, ls="--")
        panel.set_xlabel("skew [deg]")
        panel.set_ylabel("radius [H_CMG]")
        return svg(figure)


PART = PaperPart(("000.fig7.best_skew", "000.fig7.sphere"), compute)
