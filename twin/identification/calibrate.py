"""A log in SI, its unknown scales as an identification finds them: for whoever goes on with it."""

from dataclasses import replace

from twin.errors import UsageError
from twin.identification.identification import identify
from twin.platform import Platform, in_order_of
from twin.predict.logs import first_scaled, sought, usable
from twin.recording import Recording


def calibrated(recording: Recording, platform: Platform) -> Recording:
    """The log without samples that say nothing, its scales found; `repairs` says so.

    Raises:
        UsageError: a stream has `scale = "fit"` and the log does not tell the scale.
    """
    checked = usable(in_order_of(platform, recording), platform)
    if not sought(checked):
        return checked
    found = identify([checked], platform)
    notes: list[str] = []
    for scale in found.scales:
        if not scale.known:
            raise UsageError(
                f'{scale.stream} has `scale = "fit"`, and this log does not tell the scale; state '
                "it in log.toml"
            )
        notes.append(
            f"{scale.stream} was scaled by {scale.value:.3g} {scale.unit}, as the fit found it "
            f"({scale.low:.3g} to {scale.high:.3g})"
        )
    # the identification may have taken a log with pauses as several
    guess = first_scaled(checked, platform)
    scaled = guess.by({s.stream: s.value / guess.factor[s.stream] for s in found.scales}).recording
    streams = {**checked.streams, **{s.stream: scaled[s.stream] for s in found.scales}}
    facts = scaled.provenance
    known = {n: {**f, "fit_scale": False} for n, f in dict(facts["streams"]).items()}
    return replace(
        checked,
        streams=streams,
        provenance={**facts, "streams": known},
        repairs=(*checked.repairs, *notes),
    )
