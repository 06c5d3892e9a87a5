"""Logs of a machine that is stated to have what rings: it does so along a fit's motion only."""

from dataclasses import replace

from twin.effects import BodyEffect
from twin.identification.prediction_error import Fit, fit
from twin.model import Machine
from twin.predict.innovations import Problem, retraced

ROUNDS = 3
"""Times that a motion is followed, each nearer to its own."""


def rings(machine: Machine) -> bool:
    """Whether a part hangs on it that moves by itself."""
    return any(isinstance(effect, BodyEffect) and effect.hangs_on for effect in machine.effects)


def along_what_rings(problem: Problem, found: Fit) -> tuple[Problem, Fit]:
    """The same along the motion that the fit gives the logs, fitted again.

    Args:
        problem: the logs.
        found: their fit.
    """
    for _ in range(ROUNDS):
        bodies = [retraced(problem, found.innovations, log) for log in range(len(problem.bodies))]
        problem = Problem(bodies, problem.base, problem.perturbations, held=problem.held)
        starts = tuple(body.start for body in bodies)
        found = fit(problem, replace(found.at, starts=starts))
    return problem, found
