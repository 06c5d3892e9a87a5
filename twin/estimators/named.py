"""Estimators by the names that a command line takes."""

from twin.errors import UnknownName
from twin.estimators.aids import missing
from twin.estimators.attitude_filter import AttitudeFilter
from twin.estimators.estimator import Estimator, Passthrough
from twin.estimators.inclinometer import InclinometerDifferences
from twin.estimators.multiplicative_filter import MultiplicativeFilter
from twin.estimators.offset_filter import OffsetFilter
from twin.estimators.vertical_offset import VerticalOffsetFilter
from twin.platform import Platform

ESTIMATORS: dict[str, type[Estimator]] = {
    "filter": AttitudeFilter,
    "inclinometer": InclinometerDifferences,
    "mekf": MultiplicativeFilter,
    "offset": OffsetFilter,
    "passthrough": Passthrough,
    "vertical_offset": VerticalOffsetFilter,
}


def load_estimator(name: str) -> Estimator:
    """An estimator of `ESTIMATORS`, with its settings as they are.

    Raises:
        UnknownName: there is none of that name.
    """
    if name not in ESTIMATORS:
        raise UnknownName("estimator", name, ESTIMATORS)
    return ESTIMATORS[name]()


def name_of(estimator: Estimator) -> str:
    """Its name in `ESTIMATORS`; of another one, that of its class."""
    names = (name for name, kind in ESTIMATORS.items() if type(estimator) is kind)
    return next(names, type(estimator).__name__)


def usual_estimator(platform: Platform) -> str:
    """What a machine flies on unless told otherwise: the first that its streams suffice for.

    Of those that platform.toml prefers (`estimators`); else the filter of gyro and attitude; on a
    gyro without an attitude that of whatever shows the vertical; an inclinometer; the sensors as
    they are.

    Raises:
        UnknownName: platform.toml prefers one that there is not.
    """
    for name in platform.estimators:
        if name not in ESTIMATORS:
            raise UnknownName("estimator", name, ESTIMATORS)
        if _suffices(name, platform):
            return name
    usual = ("filter", "passthrough", "mekf", "inclinometer")
    return next((name for name in usual if _suffices(name, platform)), "passthrough")


def _suffices(name: str, platform: Platform) -> bool:
    sensors = set(platform.sensors)
    match name:
        case "filter":
            return {"gyro", "attitude"} <= sensors
        case "passthrough":
            return bool({"attitude", "joint_angle"} & sensors)
        case "mekf":
            return not missing(platform)
        case "inclinometer":
            return "inclinometer" in sensors
        case _:
            return {"gyro", "attitude"} <= sensors and platform.base.kind == "ball"
