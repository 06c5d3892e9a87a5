"""Estimators by the names that a command line takes."""

from twin.errors import UnknownName
from twin.estimators.attitude_filter import AttitudeFilter
from twin.estimators.estimator import Estimator
from twin.estimators.passthrough import Passthrough

ESTIMATORS: dict[str, type[Estimator]] = {"filter": AttitudeFilter, "passthrough": Passthrough}


def load_estimator(name: str) -> Estimator:
    """`filter` or `passthrough`, with its settings as they are.

    Raises:
        UnknownName: neither.
    """
    if name not in ESTIMATORS:
        raise UnknownName("estimator", name, ESTIMATORS)
    return ESTIMATORS[name]()
