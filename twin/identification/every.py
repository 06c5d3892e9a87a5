"""Every method on the same logs, side by side."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from twin.errors import TwinError
from twin.identification.identification import METHODS, Identification, by_method, ground_of
from twin.identification.methods import Settings
from twin.platform import Platform
from twin.recording import Recording

FORMS = ("torque", "momentum", "energy")
SHIFTS = (1, 2, 3)


def identify_by_all(
    recordings: Sequence[Recording],
    platform: Platform,
    settings: Settings | None = None,
    *,
    physical: bool = False,
) -> Mapping[str, Identification | TwinError]:
    """By every method, in each form and with each shift; where one cannot, why.

    Args:
        recordings: at least one, as for `identify`.
        platform: the machine, as stated.
        settings: the filter's corner and the forgetting.
        physical: give the nearest rigid bodies.

    Raises:
        TwinError: not even prediction-error can.
    """
    chosen, ground = settings or Settings(), ground_of(recordings, platform)
    found: dict[str, Identification | TwinError] = {}
    for method in METHODS:
        for variant in _variants(method, chosen):
            try:
                one = by_method(ground, method, variant, physical=physical)
            except TwinError as problem:
                if not found:
                    raise
                one = problem
            found[variant.named(method)] = one
    return found


def _variants(method: str, settings: Settings) -> list[Settings]:
    if method not in FORMS:
        return [settings]
    shifts = (0, *SHIFTS) if method == "momentum" else (0,)
    return [
        replace(settings, form=form, shift=shift)
        for shift in shifts
        for form in ("integrated", "natural")
        # without differences there is but one form
        if form == "integrated" or shift or method != "momentum"
    ]
