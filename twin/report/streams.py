"""A log with its prediction and residual beside it, as streams that Rerun shows."""

from dataclasses import replace

from twin import rotation
from twin.compare import Comparison
from twin.recording import Recording, Series


def with_prediction(comparison: Comparison) -> Recording:
    """The log plus `predicted_*` (of the best model, a start fitted a stretch) and `residual_*`.

    The residual of an attitude is a rotation vector [rad] in body axes.
    """
    streams = dict(comparison.recording.streams)
    account = comparison.best.explained
    for output, left in zip(comparison.body.outputs, account.left[0], strict=True):
        error = left * output.noise
        series = comparison.recording[output.stream]
        if output.stream == "attitude":
            predicted = rotation.multiply(output.value, rotation.from_rotation_vector(-error))
        else:
            predicted = output.value - error
        unit = "rad" if output.stream == "attitude" else series.unit
        streams[f"predicted_{output.stream}"] = Series(
            output.time, predicted, series.columns, series.unit
        )
        streams[f"residual_{output.stream}"] = Series(output.time, error, output.columns, unit)
    return replace(comparison.recording, streams=streams)
