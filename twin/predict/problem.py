"""Residuals of a recording and their derivatives, as functions of everything unknown."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.errors import TwinError
from twin.predict.base import BaseParameters
from twin.predict.rollout import Predictor

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

STEP = 1e-6
"""Of finite differences, in units of a parameter's scale."""


@dataclass(frozen=True)
class Unknowns:
    """What a fit seeks. The first three are shared by all segments, in this order."""

    theta: Array
    """(p,) base parameters."""
    biases: Array
    """(b,) of the sensors that state one [SI]."""
    strengths: Array
    """(l,) of the added torques."""
    states: Array
    """(segments, state_width) changes of the initial states."""

    @property
    def shared(self) -> int:
        """Number of shared unknowns."""
        return len(self.theta) + len(self.biases) + len(self.strengths)

    def moved(self, step: Array, states: Array) -> "Unknowns":
        """After a step of the shared ones and of the states."""
        first, second = len(self.theta), len(self.theta) + len(self.biases)
        return Unknowns(
            self.theta + step[:first],
            self.biases + step[first:second],
            self.strengths + step[second:],
            self.states + states,
        )


class Problem:
    """A recording to predict, with torques that may be added."""

    def __init__(
        self, predictor: Predictor, base: BaseParameters, shapes: Sequence[Sequence[Array]]
    ) -> None:
        self.predictor = predictor
        self.base = base
        count = len(predictor.segments)
        self._all = np.arange(count)
        empty = np.zeros((0, count, predictor.steps, predictor.base_width))
        self._shapes = np.array([list(shape) for shape in shapes]) if shapes else empty
        self._bias_columns = [predictor.bias_columns(segment) for segment in range(count)]

    def start(self) -> Unknowns:
        """The base as stated, and nothing else."""
        return Unknowns(
            self.base.as_stated,
            np.zeros(self._bias_columns[0].shape[1]),
            np.zeros(len(self._shapes)),
            np.zeros((len(self._all), self.predictor.state_width)),
        )

    def residual(self, at: Unknowns) -> list[Array]:
        """(measured - predicted) / noise of each segment, flat.

        Raises:
            TwinError: no rigid body has such a base.
        """
        plain = self.predictor.predict(
            self.base.model(at.theta), self._all, at.states, self._torque(at)
        )
        return [
            r + columns @ at.biases for r, columns in zip(plain, self._bias_columns, strict=True)
        ]

    def try_residual(self, at: Unknowns) -> list[Array] | None:
        """None where no body has such a base."""
        try:
            return self.residual(at)
        except TwinError:
            return None

    def jacobian(
        self, at: Unknowns, residual: list[Array], needed: Mask | None = None
    ) -> tuple[list[Array], list[Array]]:
        """Of each segment: d residual / d(shared unknowns) and / d(its own initial state).

        Columns of base parameters that are not `needed` are 0: they cost the most.
        """
        plain = [
            r - columns @ at.biases for r, columns in zip(residual, self._bias_columns, strict=True)
        ]
        base = [
            self._base_column(at, plain, i)
            if needed is None or needed[i]
            else [np.zeros_like(r) for r in plain]
            for i in range(len(at.theta))
        ]
        pushed, local = self._model_columns(at, plain)
        shared = [
            np.column_stack(
                [
                    *(column[s] for column in base),
                    self._bias_columns[s],
                    *(column[s] for column in pushed),
                ]
            )
            for s in self._all
        ]
        return shared, local

    def _torque(self, at: Unknowns) -> Array:
        return np.tensordot(at.strengths, self._shapes, axes=1)

    def _base_column(self, at: Unknowns, plain: list[Array], i: int) -> list[Array]:
        size = STEP * float(self.base.scale[i])
        moved = at.theta.copy()
        moved[i] += size
        run = self.predictor.predict(self.base.model(moved), self._all, at.states, self._torque(at))
        return [(r - r0) / size for r, r0 in zip(run, plain, strict=True)]

    def _model_columns(
        self, at: Unknowns, plain: list[Array]
    ) -> tuple[list[list[Array]], list[Array]]:
        """Strengths and initial states share the model, so that one batch serves them all."""
        width, count = at.states.shape[1], len(self._all)
        torque = self._torque(at)
        pushes = [torque + STEP * shape for shape in self._shapes]
        shifts = [at.states + STEP * unit for unit in np.eye(width)]
        columns = len(pushes) + width
        runs = self.predictor.predict(
            self.base.model(at.theta),
            np.tile(self._all, columns),
            np.concatenate([at.states] * len(pushes) + shifts),
            np.concatenate(pushes + [torque] * width),
        )
        slopes = [
            [(runs[c * count + s] - plain[s]) / STEP for s in self._all] for c in range(columns)
        ]
        own = slopes[len(pushes) :]
        local = [np.column_stack([column[s] for column in own]) for s in self._all]
        return slopes[: len(pushes)], local
