"""A model fitted on one log, held against another of which only the start is refitted."""

from dataclasses import dataclass, replace

import numpy as np

from twin.compare.account import Account, follow, loosen
from twin.compare.comparison import Comparison
from twin.compare.explanation import Strength
from twin.predict.whitening.innovations import Problem


@dataclass(frozen=True)
class Transfer:
    """The first log's model on another log."""

    comparison: Comparison
    """Of the other log on its own."""
    plain: Account
    """The first log's base, no symptom."""
    explained: Account
    """The first log's base and symptoms."""
    strengths: tuple[Strength, ...]
    """Of the first log."""


def transfer(fitted: Comparison, other: Comparison) -> Transfer:
    """Predict another log with the base and the symptoms of a fitted one."""
    source = fitted.best
    return Transfer(
        other,
        _held(fitted, other, source.plain, with_symptoms=False),
        _held(fitted, other, source.explained, with_symptoms=True),
        source.strengths,
    )


def _held(
    fitted: Comparison, other: Comparison, account: Account, *, with_symptoms: bool
) -> Account:
    theta = other.base.theta(fitted.base.entries(account.theta))
    joints = len(fitted.base.joints)
    if joints and fitted.base.names[-joints:] == other.base.names[-joints:]:
        theta[-joints:] = account.theta[-joints:]
    problem = Problem([other.body], other.base, held=True)
    biases = other.best.plain.at.biases
    start = problem.start(theta, biases)
    if with_symptoms and account.chosen:
        more = [p for symptom in account.chosen for p in symptom.perturbations]
        problem = Problem([other.body], other.base, more, held=True, strengths_held=True)
        start = replace(start, strengths=np.array(account.strengths))
    followed = follow(problem, account.chosen, start) if other.best.plain.follows else None
    if followed is not None and followed.follows:
        return followed
    return loosen(problem, account.chosen, start)
