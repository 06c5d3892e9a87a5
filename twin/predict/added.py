"""Perturbations of one log, stated effects included: forces, sensor errors and columns."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from twin.predict.body import Body, Exact
from twin.predict.columns import stated_of
from twin.predict.forces import Perturbation
from twin.predict.kalman import among, joined
from twin.predict.sensors import Output
from twin.predict.states import PathForces, States, carried_answers, forces_along

Array = NDArray[np.float64]
SOON = 0.1
"""Lag over which a late stream is differenced, of its period. A law that answers to noise makes a
motion jagged: its slope at an instant says little of what it was a part of a sample before."""
AT_ONCE = 2**24
"""Numbers of forces, and of changes of a state, that are worked out together: 128 MiB."""
Formed = tuple[tuple[Array, Array], ...]
"""What one perturbation does to each log: d residual (S, N), d segment's end (S - 1, x)."""


@dataclass(frozen=True)
class Added:
    """Perturbations of one log, their forces worked out along its motion."""

    body: Body
    perturbations: tuple[Perturbation, ...]
    """Those that have strengths, then what the platform states."""
    count: int
    """Of those that have strengths."""
    sizes: Array
    """(.,) of what is stated."""
    forces: Array
    """(S, steps, nv, .) at strength 1; zero for a sensor's fault."""
    rest: Array
    """(S, steps, nv) at any strength."""

    @staticmethod
    def to(body: Body, perturbations: tuple[Perturbation, ...]) -> "Added":
        """Work the forces out."""
        grid, count = body.grid, len(perturbations)
        stated, sizes = stated_of(body)
        perturbations = (*perturbations, *stated)
        forces = np.zeros((grid.segments, grid.steps, body.machine.model.nv, len(perturbations)))
        rest = np.zeros(forces.shape[:-1])
        for i, perturbation in enumerate(perturbations):
            if perturbation.force is not None:
                forces[..., i] = perturbation.force(body)
            if perturbation.rest is not None:
                rest += perturbation.rest(body)
        return Added(body, perturbations, count, sizes, forces, rest)

    @property
    def any(self) -> bool:
        """Whether there is anything at all."""
        return bool(self.perturbations)

    def push(self, strengths: Array, *, stated: bool = True) -> PathForces:
        """All together, or without what the platform states."""
        strengths = self._all(strengths, stated=stated)
        laws = tuple(
            (strength * factor, law)
            for perturbation, strength in zip(self.perturbations, strengths.tolist(), strict=True)
            for factor, law in perturbation.laws
            if strength != 0.0
        )
        return PathForces(self.rest + np.asarray(self.forces @ strengths, dtype=np.float64), laws)

    def pushes(self, strengths: Array) -> dict[str, Array]:
        """(S, steps, nv) of each, by its name, but for what answers to the path."""
        strengths = self._all(strengths)
        return {
            perturbation.name: self.forces[..., i] * strengths[i]
            for i, perturbation in enumerate(self.perturbations)
            if perturbation.force is not None
        }

    def rows(self, path: States, strengths: Array) -> Array:
        """(S, N) residual along a path (1, S, ...), the sensors at fault as they are."""
        strengths = self._all(strengths)
        step = self.body.grid.step
        parts: list[Array] = []
        for output in self.body.outputs:
            late, shown = self._late(output, strengths), np.zeros((1, *output.slot.shape))
            truth = output.predicted(path, step, late)
            for i, item in self._of(output):
                if item.shown is not None and strengths[i] != 0.0:
                    shown = shown + strengths[i] * item.shown(output, truth)
                if item.misread is not None and strengths[i] != 0.0:
                    shown = shown + strengths[i] * item.misread(output, path, step)
            parts.append(output.residual(path, step, late) - shown / output.sigma)
        return self.body.cells.scatter(parts)[0]

    def sensor_columns(self, path: States, strengths: Array) -> dict[int, Array]:
        """(S, N) d residual / d strength of each sensor's fault, by its place."""
        body, step, strengths = self.body, self.body.grid.step, self._all(strengths)
        own = range(self.count)
        faults = [i for i in own if self.perturbations[i].of_sensors]
        parts = [np.zeros((len(faults), *o.slot.shape)) for o in body.outputs]
        for output, part in zip(body.outputs, parts, strict=True):
            late = self._late(output, strengths)
            for i, item in self._of(output):
                if i not in own:
                    continue
                column = part[faults.index(i)]
                if item.shown is not None:
                    shown = item.shown(output, output.predicted(path, step, late))[0]
                    column[:] = -shown / output.sigma
                if item.misread is not None:
                    column[:] = -item.misread(output, path, step)[0] / output.sigma
                if item.late is not None:
                    # Into the past only: what a law commands at an instant answers to the noise of
                    # the sample that it read there, and would seem to explain it.
                    soon = SOON * float(np.median(np.diff(output.time)))
                    past = output.residual(path, step, late + soon)[0]
                    there = output.residual(path, step, late)[0]
                    column[:] = (past - there) / soon * item.late(output)[:, None]
        return dict(zip(faults, body.cells.scatter(parts), strict=True))

    def columns(self, exact: Exact, strengths: Array) -> tuple[Array, Array]:
        """d residual (S, N, a), d segment's end (S - 1, x, a) / d strength."""
        columns, jumps = self.force_columns(exact, strengths)
        for i, column in self.sensor_columns(exact.path, strengths).items():
            columns[..., i] += column
        return columns, jumps

    def force_columns(self, exact: Exact, strengths: Array) -> tuple[Array, Array]:
        """What the forces do, as `Body.force_columns`; those that are zero do nothing."""
        body, forces = self.body, self.forces[..., : self.count].copy()
        large: list[int] = []
        for i, perturbation in enumerate(self.perturbations[: self.count]):
            if perturbation.laws and perturbation.size != 0.0 and strengths[i] == 0.0:
                large.append(i)
            elif perturbation.laws:
                forces[..., i] += forces_along(
                    perturbation.laws, body.machine, exact.path, body.begins
                )
        acting = np.any(forces, axis=(0, 1, 2))
        result = body.force_columns(exact, forces[..., acting])
        columns, jumps = (among(item, acting) for item in result)
        for i in large:
            answers = body.columns_of(exact, self._answers(exact, i)[..., None])
            columns[..., i] += answers[0][..., 0]
            jumps[..., i] += answers[1][..., 0]
        return columns, jumps

    def _answers(self, exact: Exact, index: int) -> Array:
        """(S, steps + 1, x) changes of the state by the laws of a perturbation at its size, over
        that size."""
        item, body = self.perturbations[index], self.body
        laws = tuple((item.size * factor, law) for factor, law in item.laws)
        push = PathForces(np.zeros_like(self.rest), laws)
        carried, machine = exact.local.carried, body.machine
        change = carried_answers(carried, exact.answer, push, machine, exact.path, body.begins)
        return change / item.size

    def _all(self, strengths: Array, *, stated: bool = True) -> Array:
        return np.concatenate([strengths, self.sizes if stated else np.zeros_like(self.sizes)])

    def _of(self, output: Output) -> list[tuple[int, Perturbation]]:
        """What is wrong with a stream."""
        every = enumerate(self.perturbations)
        return [(i, p) for i, p in every if p.misread or p.stream == output.stream]

    def _late(self, output: Output, strengths: Array) -> Array:
        late = np.zeros(len(output.time))
        for i, item in self._of(output):
            if item.late is not None:
                late = late + strengths[i] * item.late(output)
        return late


def formed(
    bodies: Sequence[Body], exact: Sequence[Exact], perturbations: Sequence[Perturbation]
) -> list[Formed]:
    """Each perturbation's columns, at a strength of 0, where the logs were linearised."""
    if not perturbations:
        return []
    logs = [_of_log(body, item, perturbations) for body, item in zip(bodies, exact, strict=True)]
    return list(zip(*logs, strict=True))


def _of_log(
    body: Body, exact: Exact, perturbations: Sequence[Perturbation]
) -> list[tuple[Array, Array]]:
    """So many together that what is kept of each step stays within AT_ONCE."""
    each = body.grid.segments * body.grid.steps * sum(exact.answer.shape[2:])
    together = max(AT_ONCE // each, 1)
    result: list[tuple[Array, Array]] = []
    for first in range(0, len(perturbations), together):
        more = tuple(perturbations[first : first + together])
        columns, jumps = Added.to(body, more).columns(exact, np.zeros(len(more)))
        result += [(columns[..., i], jumps[..., i]) for i in range(len(more))]
    return result


def with_formed(exact: Sequence[Exact], every: Sequence[Formed]) -> tuple[Exact, ...]:
    """What was linearised, with columns that were formed there; to be whitened."""
    if not every:
        return tuple(exact)
    return tuple(
        replace(
            item,
            linear=replace(
                item.linear,
                shared=joined(item.linear.shared, *(logs[i][0][..., None] for logs in every)),
                jump_shared=joined(
                    item.linear.jump_shared, *(logs[i][1][..., None] for logs in every)
                ),
            ),
        )
        for i, item in enumerate(exact)
    )
