"""A log in SI, its unknown scales as an identification finds them: for whoever goes on with it."""

from dataclasses import replace

from twin.errors import UsageError
from twin.identify.identification import identify
from twin.platform import Platform, in_order_of
from twin.predict.log.ranges import within_range
from twin.predict.log.scales import sought
from twin.recording import Recording


def calibrated(recording: Recording, platform: Platform) -> Recording:
    """The log without samples at the end of a range, its scales found; `repairs` says so.

    Raises:
        UsageError: a stream has `scale = "fit"` and the log does not tell the scale.
    """
    checked, said = within_range(in_order_of(platform, recording), platform)
    checked = replace(checked, repairs=(*checked.repairs, *said))
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
    scaled = found.recordings[0]
    streams = {**checked.streams, **{s.stream: scaled[s.stream] for s in found.scales}}
    facts = scaled.provenance
    known = {n: {**f, "fit_scale": False} for n, f in dict(facts["streams"]).items()}
    return replace(
        checked,
        streams=streams,
        provenance={**facts, "streams": known},
        repairs=(*checked.repairs, *notes),
    )
