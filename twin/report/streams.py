"""A log with its prediction and residual beside it, as streams that Rerun shows."""

from dataclasses import replace

from twin import rotation
from twin.comparison.account import Account
from twin.recording import Recording, Series
from twin.signals import PREDICTED, RESIDUAL


def with_prediction(account: Account) -> Recording:
    """An account's first log plus `predicted_*` (a start fitted a stretch) and `residual_*`.

    The residual of an attitude is a rotation vector [rad] in body axes.
    """
    body = account.problem.bodies[0]
    streams = dict(body.recording.streams)
    for output, left in zip(body.outputs, account.left[0], strict=True):
        error = left * output.sigma
        series = body.recording[output.stream]
        if output.stream == "attitude":
            predicted = rotation.multiply(output.value, rotation.from_rotation_vector(-error))
        else:
            predicted = output.value - error
        unit = "rad" if output.stream == "attitude" else series.unit
        streams[f"{PREDICTED}{output.stream}"] = Series(
            output.time, predicted, series.columns, series.unit
        )
        streams[f"{RESIDUAL}{output.stream}"] = Series(output.time, error, output.columns, unit)
    return replace(body.recording, streams=streams)
