"""A log with its prediction and residual beside it, as streams that Rerun shows."""

from dataclasses import replace

import numpy as np

from twin import rotation
from twin.predict.compare import Comparison
from twin.recording import Recording, Series


def with_prediction(comparison: Comparison) -> Recording:
    """The log plus `predicted_*` (of the best model, a start fitted a stretch) and `residual_*`.

    The residual of an attitude is a rotation vector [rad] in body axes.
    """
    streams = dict(comparison.recording.streams)
    found, predictor = comparison.best.explanation.fit, comparison.predictor
    for output in predictor.outputs:
        parts = [predictor.split(s, flat)[output.stream] for s, flat in enumerate(found.residual)]
        time = np.concatenate([part for part, _ in parts])
        error = np.concatenate([part for _, part in parts])
        measured = output.series.value[np.searchsorted(output.series.time, time)]
        if output.stream == "attitude":
            predicted = rotation.multiply(measured, rotation.from_rotation_vector(-error))
            axes, unit = ("x", "y", "z"), "rad"
        else:
            predicted, axes, unit = measured - error, output.series.columns, output.series.unit
        streams[f"predicted_{output.stream}"] = Series(
            time, predicted, output.series.columns, output.series.unit
        )
        streams[f"residual_{output.stream}"] = Series(time, error, axes, unit)
    return replace(comparison.recording, streams=streams)
