"""Digital twin for air-bearing spacecraft simulators.

The functions here are what the verbs of the command line do; `twin.api` describes them. They are
imported when they are first used.
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from twin.api import balance as balance
    from twin.api import campaign as campaign
    from twin.api import check_log as check_log
    from twin.api import compare as compare
    from twin.api import compare_sensors as compare_sensors
    from twin.api import diagnose as diagnose
    from twin.api import extend as extend
    from twin.api import fly as fly
    from twin.api import fly_campaign as fly_campaign
    from twin.api import forecast as forecast
    from twin.api import identify as identify
    from twin.api import identify_by_all as identify_by_all
    from twin.api import import_log as import_log
    from twin.api import load as load
    from twin.api import machine_of as machine_of
    from twin.api import new as new
    from twin.api import read as read
    from twin.api import replay as replay
    from twin.api import results as results
    from twin.api import show as show
    from twin.api import transfer as transfer
    from twin.api import validate as validate
    from twin.controller import Controller as Controller
    from twin.effects import Effect as Effect
    from twin.errors import TwinError as TwinError
    from twin.experiments.calibration import calibrate as calibrate
    from twin.experiments.design import excite as excite
    from twin.experiments.isolation import isolate as isolate
    from twin.experiments.routine import history as history
    from twin.experiments.routine import trim as trim
    from twin.experiments.routine import verify as verify
    from twin.experiments.tuning import tune as tune
    from twin.formation import fly_formation as fly_formation
    from twin.platform import Platform as Platform
    from twin.radio import Radio as Radio
    from twin.recording import Recording as Recording
    from twin.recording import Series as Series

__version__: str

_FROM = {  # all other names are of `twin.api`
    "Controller": "twin.controller",
    "Effect": "twin.effects",
    "TwinError": "twin.errors",
    "calibrate": "twin.experiments.calibration",
    "excite": "twin.experiments.design",
    "history": "twin.experiments.routine",
    "trim": "twin.experiments.routine",
    "tune": "twin.experiments.tuning",
    "verify": "twin.experiments.routine",
    "isolate": "twin.experiments.isolation",
    "Platform": "twin.platform",
    "Radio": "twin.radio",
    "fly_formation": "twin.formation",
    "Recording": "twin.recording",
    "Series": "twin.recording",
}
__all__ = [
    "Controller",
    "Effect",
    "Platform",
    "Radio",
    "Recording",
    "Series",
    "TwinError",
    "balance",
    "calibrate",
    "campaign",
    "check_log",
    "compare",
    "compare_sensors",
    "diagnose",
    "excite",
    "extend",
    "fly",
    "fly_campaign",
    "fly_formation",
    "forecast",
    "history",
    "identify",
    "identify_by_all",
    "import_log",
    "isolate",
    "load",
    "machine_of",
    "new",
    "read",
    "replay",
    "results",
    "show",
    "transfer",
    "trim",
    "tune",
    "validate",
    "verify",
]


def __getattr__(name: str) -> Any:
    # Looking the version up costs more than the rest of `twin --help`.
    if name == "__version__":
        from importlib.metadata import version

        return version("airbearing-twin")
    module = _FROM.get(name, "twin.api")
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(module), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
