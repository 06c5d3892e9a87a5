"""A model held against a log: as built and refitted, what it misses, and which law it lacks."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.model import compile_model
from twin.platform import Platform
from twin.predict.base import BaseParameters, base_parameters
from twin.predict.explain import Explanation, Strength, explain
from twin.predict.fit import Fit, fit
from twin.predict.laws import shape_of
from twin.predict.motion import motion_of, noise_of
from twin.predict.rollout import Predictor
from twin.predict.segments import Segment, cut
from twin.recording import Recording

Array = NDArray[np.float64]

HORIZONS = (1.0, 10.0, 60.0)
"""Of the free runs [s]."""

STANDS_OUT = 10.0
"""A stretch is disturbed when its residual is so many times the median stretch's."""


@dataclass(frozen=True)
class StreamError:
    """What a model misses of one stream, in its SI unit."""

    stream: str
    unit: str
    noise: float
    """1 sigma a sample, over the columns."""
    noise_stated: bool
    """By the log; else estimated from its data."""
    rms: float
    typical: float
    """The rms of the median segment: what is missed where nothing special happens."""
    worst: float
    worst_time: float
    """[s]."""
    chi2_per_sample: float


@dataclass(frozen=True)
class Account:
    """One way to set the model's parameters, and what it then misses."""

    plain: Fit
    """Without any law."""
    explanation: Explanation
    """With the laws that pay."""


@dataclass(frozen=True)
class FreeRun:
    """Predictions over stretches of one length, started from the smoothed motion, nothing fitted.

    Times (m,) and errors (m, k) of each stretch, in the first predicted stream [rad].
    """

    horizon: float
    """Length of a stretch [s]."""
    as_built: list[tuple[Array, Array]]
    best: list[tuple[Array, Array]]

    @property
    def ends(self) -> tuple[float, float]:
        """Median error at the end of a stretch [rad], as built and of the best model."""
        built, best = (
            float(np.median([np.linalg.norm(error[-1]) for _, error in runs]))
            for runs in (self.as_built, self.best)
        )
        return built, best


@dataclass(frozen=True)
class Comparison:
    """A platform's model held against one log."""

    platform: Platform
    recording: Recording
    predictor: Predictor
    base: BaseParameters
    as_built: Account
    refitted: Account | None
    """None where the base was to stay as built."""
    free_runs: Mapping[float, FreeRun | None]
    """By horizon [s]; None where the log is too short."""

    @property
    def best(self) -> Account:
        """Refitted, unless that was not asked for."""
        return self.refitted or self.as_built

    @property
    def healthy(self) -> bool:
        """Whether the best model without any law leaves nothing but noise."""
        return self.best.plain.is_noise and not self.best.explanation.laws

    @property
    def verdict(self) -> str:
        """healthy, explained or unexplained."""
        if self.healthy:
            return "healthy"
        return "explained" if self.best.explanation.fit.is_noise else "unexplained"


@dataclass(frozen=True)
class Transfer:
    """A model fitted on one log, held against another of which only the start is refitted."""

    comparison: Comparison
    """Of the other log on its own."""
    plain: Fit
    """The first log's base, no law."""
    with_laws: Fit
    """The first log's base and laws."""
    laws: tuple[Strength, ...]
    """Of the first log."""


def compare(recording: Recording, platform: Platform, *, as_built: bool = False) -> Comparison:
    """Hold a platform's model against a log.

    Args:
        recording: a measured log, or a run.
        platform: the machine it was measured on.
        as_built: leave the base as platform.toml states it; only initial states are fitted.

    Raises:
        UsageError: the log lacks the streams that the prediction needs.
    """
    recording = recording.without_truth()
    predictor, base = prepare(recording, platform)
    accounts = [_account(predictor, base, refit_base=False)]
    if not as_built:
        accounts.append(_account(predictor, base, refit_base=True))
    return Comparison(
        platform,
        recording,
        predictor,
        base,
        accounts[0],
        accounts[1] if len(accounts) > 1 else None,
        {
            horizon: _free_run(predictor, base, horizon, accounts[0].plain, accounts[-1])
            for horizon in HORIZONS
        },
    )


def transfer(fitted: Comparison, other: Comparison) -> Transfer:
    """Predict another log with the base and laws of a fitted one."""
    source = fitted.best
    laws = source.explanation.laws
    plain_theta = other.base.theta(fitted.base.entries(source.plain.theta))
    theta = other.base.theta(fitted.base.entries(source.explanation.fit.theta))
    predictor = other.predictor
    return Transfer(
        other,
        fit(predictor, other.base, theta=plain_theta, refit_base=False),
        fit(
            predictor,
            other.base,
            theta=theta,
            shapes=[shape_of(strength.law, predictor) for strength in laws],
            strengths=np.array([strength.value for strength in laws]),
            refit_base=False,
            refit_strengths=False,
        ),
        laws,
    )


def prepare(recording: Recording, platform: Platform) -> tuple[Predictor, BaseParameters]:
    """Everything that a prediction of a recording needs."""
    machine = compile_model(platform)
    motion = motion_of(recording, platform)
    predictor = Predictor(machine, recording, motion, cut(machine, motion))
    return predictor, base_parameters(machine)


def stream_errors(predictor: Predictor, found: Fit) -> list[StreamError]:
    """What a fit misses, stream by stream."""
    parts = [predictor.split(s, flat) for s, flat in enumerate(found.residual)]
    errors: list[StreamError] = []
    for output in predictor.outputs:
        times = np.concatenate([part[output.stream][0] for part in parts])
        values = np.concatenate([part[output.stream][1] for part in parts])
        size = np.linalg.norm(values, axis=1)
        worst = int(np.argmax(size))
        rms = [
            float(np.sqrt(np.mean(np.square(part[output.stream][1]))))
            for part in parts
            if len(part[output.stream][1])
        ]
        unit = "rad" if output.stream == "attitude" else output.series.unit
        errors.append(
            StreamError(
                output.stream,
                unit,
                float(np.sqrt(np.mean(np.square(output.noise)))),
                output.stated,
                float(np.sqrt(np.mean(np.square(values)))),
                float(np.median(rms)),
                float(size[worst]),
                float(times[worst]),
                float(np.mean(np.square(values / output.noise))),
            )
        )
    return errors


def disturbed(predictor: Predictor, found: Fit) -> list[Segment]:
    """Stretches whose residual stands out: something acted that no law knows."""
    sizes = np.array([float(np.mean(np.square(r))) for r in found.residual])
    limit = STANDS_OUT**2 * max(float(np.median(sizes)), 1.0)
    return [
        segment for segment, size in zip(predictor.segments, sizes, strict=True) if size > limit
    ]


def noise_findings(comparison: Comparison) -> list[str]:
    """Sensors whose stated noise is off from that of the data by more than a factor of 1.5."""
    sentences: list[str] = []
    for output in comparison.predictor.outputs:
        sensor = comparison.platform.sensors.get(output.stream)
        if sensor is None or output.stated:
            continue
        found = float(np.sqrt(np.mean(np.square(noise_of(output.series)))))
        stated = float(np.sqrt(np.mean(np.square(sensor.noise))))
        if stated > 0.0 and not 1.0 / 1.5 <= found / stated <= 1.5:
            sentences.append(
                f"The noise of {output.stream} is {found / stated:.2g} times what platform.toml "
                f"states ({found:.3g} instead of {stated:.3g} {output.series.unit})."
            )
    return sentences


def _account(predictor: Predictor, base: BaseParameters, *, refit_base: bool) -> Account:
    plain = fit(predictor, base, refit_base=refit_base)
    return Account(plain, explain(predictor, base, plain, refit_base=refit_base))


def _free_run(
    predictor: Predictor, base: BaseParameters, horizon: float, built: Fit, best: Account
) -> FreeRun | None:
    motion = predictor.motion
    begin, end = float(motion.time[0]), float(motion.time[-1])
    count = int((end - begin) // horizon)
    if count == 0:
        return None
    runs = tuple(Segment(begin + i * horizon, begin + (i + 1) * horizon) for i in range(count))
    free = Predictor(predictor.machine, predictor.recording, motion, runs)
    torque = np.zeros((count, free.steps, free.base_width))
    for strength in best.explanation.laws:
        torque += strength.value * np.array(shape_of(strength.law, free))
    still = np.zeros((count, free.state_width))
    first = free.outputs[0].stream
    errors: list[list[tuple[Array, Array]]] = []
    for theta, added in ((built.theta, None), (best.explanation.fit.theta, torque)):
        residual = free.predict(base.model(theta), np.arange(count), still, added)
        errors.append([free.split(s, flat)[first] for s, flat in enumerate(residual)])
    return FreeRun(horizon, errors[0], errors[1])
