"""Simulated sensors: each stream on its own clock, with the faults that platform.toml states.

The low-pass filter in a sensor: Butterworth, on every physics step.
Discretised for an input that is straight within a step (first-order hold): slow signals come late
by the analogue filter's delay, however long the step. The usual bilinear form, warped to meet the
cutoff, is early by 3 % at a tenth of the rate of steps.

A stream whose period is no multiple of the physics step is sampled at the next step and stamped so.
Latency delays the arrival, never the stamp: a sample's time is when its value was true. Noise comes
from one SFC64 generator a run and stream, so neither another run nor another stream changes it.

A stream's effects act in their order: before the noise on the values, after it on the stamps. A
sample arrives once its stamp has come.
"""

import zlib
from collections import deque
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from twin.effects import Order, ScatterEffect, SeriesEffect
from twin.platform import Platform, Sensor
from twin.rotation import from_rotation_vector, multiply
from twin.signals import Samples

Array = NDArray[np.float64]


class LowPass:
    """In rest at the first value that it sees."""

    def __init__(self, sensor: Sensor, step: float) -> None:
        from scipy.signal import sosfilt_zi  # takes a while, and few sensors need it

        self._sections = sections_of(sensor, step)
        self._rest = sosfilt_zi(self._sections)[:, None, :, None]
        self._memory: Array | None = None

    def __call__(self, truth: Array) -> Array:
        """The next steps (n, steps, k), filtered."""
        from scipy.signal import sosfilt

        if self._memory is None:
            self._memory = self._rest * truth[None, :, :1]
        passed, self._memory = sosfilt(self._sections, truth, axis=1, zi=self._memory)
        return passed


def sections_of(sensor: Sensor, step: float) -> Array:
    """(sections, 6) of second order, as SciPy's `sosfilt` takes them."""
    from scipy.signal import butter, cont2discrete, tf2sos

    analogue = butter(sensor.order, 2.0 * np.pi * sensor.cutoff, analog=True)
    top, bottom, _ = cont2discrete(analogue, step, method="foh")
    return np.asarray(tf2sos(np.squeeze(top), bottom), dtype=np.float64)


_EPS = 1e-9
_DRAWN_AHEAD = 256
"""Samples whose noise is drawn at once: large enough that a call a run costs little a tick."""


class SimulatedSensor:
    """One stream of n runs: truth at every physics step in, samples that arrived out."""

    def __init__(
        self,
        sensor: Sensor,
        runs: Sequence[int],
        seed: int,
        platform: Platform,
        effects: Sequence[SeriesEffect] = (),
        scatter: Sequence[ScatterEffect] = (),
    ) -> None:
        """Begin before the first sample.

        Args:
            sensor: one of the platform's.
            runs: their numbers.
            seed: of all random numbers.
            platform: the machine.
            effects: those that act on the stream, in their order.
            scatter: those that add to its noise.
        """
        step = platform.step
        self.sensor = sensor
        self.scatter = tuple(scatter)
        self._platform = platform
        self._before = [e.live(platform) for e in effects if e.order < Order.noise]
        self._after = [e.live(platform) for e in effects if e.order > Order.noise]
        self._waits = bool(sensor.latency or self._after)
        self._step = step
        self._period = 1.0 / (sensor.rate * step)
        whole = round(self._period)
        self._whole_period = whole if abs(self._period - whole) < _EPS * whole else 0
        key = zlib.crc32(sensor.stream.encode())
        self._generators = [
            np.random.Generator(np.random.SFC64(np.random.SeedSequence([seed, run, key])))
            for run in runs
        ]
        self._noise = _Ahead(self._draw_noise)
        self._uniform = _Ahead(self._draw_uniform)
        self._noisy = bool(sensor.noise.any())
        bias = np.stack([g.standard_normal(len(sensor.bias)) for g in self._generators])
        self._bias = (bias * sensor.bias)[:, None, :] if sensor.bias.any() else None
        self.filtered = bool(np.isfinite(sensor.cutoff))
        """Whether it must see every physics step."""
        self._low_pass = LowPass(sensor, step) if self.filtered else None
        if scatter:
            self._shaken = [
                np.random.Generator(np.random.SFC64(np.random.SeedSequence([seed, run, key, 1])))
                for run in runs
            ]
            self._white = _Ahead(self._draw_white)
        self._late: deque[Samples] = deque()
        self._all_valid: dict[int, NDArray[np.bool_]] = {}

    def picks(self, done: int, steps: int) -> slice | NDArray[np.intp]:
        """Which of the `steps` physics steps after step number `done` are sampled, from 0."""
        if self._whole_period:
            period = self._whole_period
            return slice((-(done + 1)) % period, steps, period)
        first = int(np.floor(done / self._period + _EPS)) + 1
        last = int(np.floor((done + steps) / self._period + _EPS))
        instants = np.ceil(np.arange(first, last + 1) * self._period - _EPS).astype(np.intp)
        return instants - done - 1

    def low_passed(self, truth: Array) -> Array:
        """What the sensor's filter leaves of every physics step, (n, steps, k)."""
        return truth if self._low_pass is None else self._low_pass(truth)

    def measure(
        self,
        truth: Array,
        time: Array,
        valid: NDArray[np.bool_] | None,
        causes: Sequence[Array] = (),
    ) -> None:
        """Take samples.

        Args:
            truth: (n, m, k).
            time: when it was true, (m,) [s].
            valid: (n,) masks runs; None: all are.
            causes: true cause of each effect that adds noise, (n, m, j).
        """
        n, m = truth.shape[:2]
        if m == 0:
            return
        stamps = np.empty((n, m))
        stamps[:] = time
        kept = self._kept(n, m, valid)
        for act in self._before:
            truth = act(Samples(truth, stamps, kept)).value
        if causes:
            truth = truth + self._shake(truth.shape[1], causes)
        samples = Samples(self._disturbed(truth), stamps, kept)
        for act in self._after:
            samples = act(samples)
        self._late.append(samples)

    def arrived(self, until: float) -> Samples | None:
        """What has arrived by `until` [s] and was not given out before; None if nothing."""
        if not self._late:
            return None
        if not self._waits and len(self._late) == 1:
            return self._late.popleft()
        blocks = list(self._late)
        self._late.clear()
        value = np.concatenate([block.value for block in blocks], axis=1)
        time = np.concatenate([block.time for block in blocks], axis=1)
        valid = np.concatenate([block.valid for block in blocks], axis=1)
        count = int(np.searchsorted(time[0] + self.sensor.latency, until + _EPS, side="right"))
        if count < time.shape[1]:
            self._late.append(Samples(value[:, count:], time[:, count:], valid[:, count:]))
        if count == 0:
            return None
        return Samples(value[:, :count], time[:, :count], valid[:, :count])

    def _shake(self, m: int, causes: Sequence[Array]) -> Array:
        variances = [
            np.square(effect.sigma(cause, self._platform))
            for effect, cause in zip(self.scatter, causes, strict=True)
        ]
        return self._white.take(m) * np.sqrt(np.sum(np.broadcast_arrays(*variances), axis=0))

    def _disturbed(self, truth: Array) -> Array:
        sensor, error = self.sensor, self._error(truth.shape[1])
        if error is None:
            value = truth.copy()
        elif sensor.stream == "attitude":
            value = multiply(truth, from_rotation_vector(error))
        else:
            value = truth + error
        if sensor.resolution:
            value = np.round(value / sensor.resolution) * sensor.resolution
        if np.isfinite(sensor.range):
            value = np.clip(value, -sensor.range, sensor.range)
        return value

    def _error(self, m: int) -> Array | None:
        """Bias plus noise of the next m samples; None where there is neither."""
        if not self._noisy:
            return self._bias
        noise = self._noise.take(m)
        return noise if self._bias is None else noise + self._bias

    def _kept(self, n: int, m: int, valid: NDArray[np.bool_] | None) -> NDArray[np.bool_]:
        if not self.sensor.dropout and valid is None:
            if m not in self._all_valid:
                self._all_valid[m] = np.ones((n, m), dtype=np.bool_)
                self._all_valid[m].flags.writeable = False
            return self._all_valid[m]
        kept = np.ones((n, m), dtype=np.bool_)
        if valid is not None:
            kept &= valid[:, None]
        if self.sensor.dropout:
            kept &= self._uniform.take(m)[:, :, 0] >= self.sensor.dropout
        return kept

    def _draw_noise(self, count: int) -> Array:
        width = len(self.sensor.noise)
        block = np.empty((len(self._generators), count, width))
        for row, generator in zip(block, self._generators, strict=True):
            generator.standard_normal(out=row)
        block *= self.sensor.noise
        return block

    def _draw_white(self, count: int) -> Array:
        shape = count, len(self.sensor.noise)
        return np.stack([generator.standard_normal(shape) for generator in self._shaken])

    def _draw_uniform(self, count: int) -> Array:
        return np.stack([generator.random((count, 1)) for generator in self._generators])


class _Ahead:
    """Random numbers drawn in blocks, handed out a few at a time along axis 1."""

    def __init__(self, draw: Callable[[int], Array]) -> None:
        self._draw = draw
        self._block = np.empty((0, 0, 0))
        self._used = 0

    def take(self, count: int) -> Array:
        start, stop = self._used, self._used + count
        if stop <= self._block.shape[1]:
            self._used = stop
            return self._block[:, start:stop]
        left = self._block[:, start:]
        fresh = self._draw(max(_DRAWN_AHEAD, count))
        short = count - left.shape[1]
        self._block, self._used = fresh, short
        return np.concatenate([left, fresh[:, :short]], axis=1) if left.size else fresh[:, :short]
