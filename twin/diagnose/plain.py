"""The model without any cause: its base fitted to logs, which all reasoning begins from."""

from collections.abc import Sequence

import numpy as np

from twin.diagnose.explanation import Explanation, explain
from twin.diagnose.grounds import check_numbers
from twin.identify.momentum import momentum_fit
from twin.identify.prediction_error import Fit, fit_disturbed
from twin.identify.ringing import along_what_rings, rings
from twin.identify.start import base_of, first_biases, first_theta
from twin.platform import Platform
from twin.predict.body import body_of
from twin.predict.effects.machine import predicted_machine
from twin.predict.log.motion import motion_of
from twin.predict.whitening.innovations import Innovations, Problem
from twin.recording import Recording


def plain_of(logs: Sequence[Recording], platform: Platform, *, follows: bool = True) -> Explanation:
    """The base fitted, and nothing else."""
    machine = predicted_machine(platform)
    bodies = [body_of(machine, log, motion_of(log, platform)) for log in logs]
    plain, base = base_of(machine, logs)
    check_numbers(bodies, base)
    pairs = [(log, body.motion) for log, body in zip(logs, bodies, strict=True)]
    first = first_theta(plain, momentum_fit(pairs, plain))
    theta = np.concatenate([first, base.as_stated[len(first) :]])
    problem = Problem(bodies, base)
    biases = [first_biases(body) for body in bodies]
    start = problem.start(theta, biases)
    found = explain(bodies, base, (), start, follows=follows)
    if not isinstance(found.now, Innovations):
        return found
    if not found.converged:
        # the momentum may be off by more than it says, and the machine as stated be nearer
        start_as_stated = problem.start(base.as_stated, biases)
        again = explain(bodies, base, (), start_as_stated, follows=follows)
        found = min(found, again, key=lambda one: one.cost)
    if not found.converged and isinstance(found.now, Innovations):
        # a motion that may stray from the model leads closer, however bad the start
        near = fit_disturbed(problem, Fit(found.now, converged=False), start)
        again = explain(bodies, base, (), near.at, follows=follows)
        found = min(found, again, key=lambda one: one.cost)
    if rings(machine) and isinstance(found.now, Innovations):
        settled = Fit(found.now, converged=found.converged)
        bodies = along_what_rings(found.problem, settled)[0].bodies
        found = explain(bodies, base, (), found.at, follows=follows)
    left = found.account.left
    known = [body.with_noise_of(parts) for body, parts in zip(bodies, left, strict=True)]
    if all(new is body for new, body in zip(known, bodies, strict=True)):
        return found
    return explain(known, base, (), found.at, follows=follows)
