"""Logs with what every real log has besides: draughts, a straying attitude, lost samples, jitter.

    python tests/promises/mess.py --cases 12 --seed 1 --jobs 2

hides a cause in each of so many logs, of an evidence that a perfect method would have without the
mess, and every fourth time none; the wandering torque is 0.03, 0.1 or 0.3 of the cause's own. It
prints a line a case and counts what was named first, the verdicts and the intervals that hold.
"""

import argparse
import sys
import time
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

sys.path.insert(0, str(Path(__file__).parent))

from benches import LIBRARY, Bench, machine, yardstick  # noqa: E402
from hidden import Hidden, OutOfReach, any_of, hide, labels_of  # noqa: E402

from twin import rotation  # noqa: E402
from twin.diagnosis import Diagnosis, diagnose  # noqa: E402
from twin.diagnosis.baseline import baseline_of  # noqa: E402
from twin.effects import BodyEffect, Effect  # noqa: E402
from twin.effects.effect import Domain, parameter  # noqa: E402
from twin.effects.on_body import TorqueLaw  # noqa: E402
from twin.errors import TwinError  # noqa: E402
from twin.platform import Platform  # noqa: E402
from twin.predict.columns import amplitudes  # noqa: E402
from twin.processes import Pool  # noqa: E402
from twin.recording import Recording  # noqa: E402

Array = NDArray[np.float64]

EVIDENCE = 20_000.0
"""Of a hidden cause, were there no mess."""
SHARES = (0.03, 0.1, 0.3)
"""Rms of the wandering torque, of the cause's own."""
DRAUGHT = 2e-5
"""Rms of the wandering torque where the cause has none, or there is no cause [N m]."""
DURATION, RATE = 150.0, 100.0
"""Of a log [s], and of its gyro and attitude [Hz]."""
STRAY, STRAY_TIME = 0.5, 20.0
"""Rms of the attitude's slow error, in parts of a sample's noise, and its correlation time [s]."""
LOST = 0.005
"""Share of the samples that are lost."""
JITTER = 2e-4
"""Of their stamps, 1 sigma [s]."""
STEP = 0.05
"""Between two instants at which a wandering torque is drawn [s]."""
KINDS = (
    "aerodynamic_drag",
    "bearing_coulomb_friction",
    "bearing_viscous_friction",
    "harness_stiffness",
    "wheel_friction",
    "wheel_inertia_error",
    "wheel_misalignment",
    "gyro_scale_factor",
    "gyro_misalignment",
    "clock_lag",
    "residual_dipole",
    "thruster_misalignment",
    "magnetorquer_gain",
    "wheel_torque_gain",
)
"""Of causes, as far as a bench shows them."""


@dataclass(frozen=True)
class Gusts(BodyEffect):
    """An Ornstein-Uhlenbeck torque about each body axis."""

    name = "gusts"
    domain = Domain.torque
    observable = "a torque that wanders"
    streams = ("gyro",)

    rms: float = parameter("rms", "N m", 1e-5, source="tests", low=0.0, high=1.0)
    time: float = field(default=3.0)
    """Correlation time [s]."""
    seed: int = field(default=0)

    def torque(self, platform: Platform) -> TorqueLaw:
        rng = np.random.default_rng(self.seed)
        drawn = self.rms * wander(rng, round(1000.0 / STEP), STEP, self.time)

        def law(state: Any) -> Array:
            place = np.minimum(state.time / STEP, len(drawn) - 1.001)
            whole = place.astype(np.intp)
            share = (place - whole)[:, None]
            return drawn[whole] * (1.0 - share) + drawn[whole + 1] * share

        return law


def wander(rng: np.random.Generator, count: int, step: float, time: float) -> Array:
    """(count, 3) of an Ornstein-Uhlenbeck process of variance 1."""
    kept = np.exp(-step / time)
    steps = np.sqrt(1.0 - kept**2) * rng.standard_normal((count, 3))
    steps[0] /= np.sqrt(1.0 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], steps, axis=0))


def messed(log: Recording, rng: np.random.Generator, noise: float) -> Recording:
    """A log whose attitude strays, and whose fast streams lose samples and jitter.

    Args:
        log: as simulated.
        rng: of what is drawn.
        noise: 1 sigma of a sample of the attitude [rad].
    """
    streams = dict(log.streams)
    if "attitude" in streams:
        series = streams["attitude"]
        step = float(np.median(np.diff(series.time)))
        error = STRAY * noise * wander(rng, len(series), step, STRAY_TIME)
        turned = rotation.multiply(series.value, rotation.from_rotation_vector(error))
        streams["attitude"] = replace(series, value=turned)
    for name in ("attitude", "gyro"):
        if name in streams:
            series = streams[name]
            kept = rng.uniform(size=len(series)) > LOST
            stamps = series.time[kept] + JITTER * rng.standard_normal(int(kept.sum()))
            streams[name] = replace(
                series, time=np.maximum.accumulate(stamps), value=series.value[kept]
            )
    return replace(log, streams=streams)


def own_torque(bench: Bench, effect: Effect) -> float:
    """Rms of what an effect pushes the base with, about an axis [N m]; 0 of a sensor's fault."""
    measure, platform = yardstick(bench), machine(bench)
    if not isinstance(effect, BodyEffect) or effect.label not in measure.labels:
        return 0.0
    quiet = hide(bench, (), 0)
    law = effect.torque(platform)
    if law is None:
        return 0.0
    plain = baseline_of([quiet.log], platform)
    (body,) = plain.bodies
    path = plain.prediction.exact[0].path
    middle = path[0, :, :-1].flat.with_time(body.begins.ravel())
    return float(np.sqrt(np.mean(np.square(law(middle)))))


@dataclass(frozen=True)
class Messy:
    """A log with mess, and what is hidden in it."""

    secret: Hidden
    share: float
    rms: float
    """Of the wandering torque [N m]."""

    @property
    def truth(self) -> list[str]:
        """Labels of what is hidden."""
        return [e.label for e in self.secret.effects if not isinstance(e, Gusts)]


def draw(seed: int) -> Messy:
    """A case by its number: every fourth hides nothing.

    Raises:
        OutOfReach: the machine cannot have what was drawn.
    """
    rng = np.random.default_rng([seed, 46])
    share = SHARES[seed % len(SHARES)]
    while True:
        bench = replace(LIBRARY[rng.integers(len(LIBRARY))], duration=DURATION, rate=RATE)
        kind = "" if seed % 4 == 3 else str(rng.choice(KINDS))
        try:
            if kind and not labels_of(yardstick(bench), kind):
                continue
            effects = [any_of(bench, EVIDENCE, rng, kind)] if kind else []
            torque = sum(own_torque(bench, effect) for effect in effects)
            rms = share * torque if torque else DRAUGHT
            gusts = Gusts(rms=rms, seed=seed)
            secret = hide(bench, (*effects, gusts), seed)
        except (OutOfReach, TwinError) as why:
            print(f"  drawn again: {why}", flush=True)
            continue
        noise = float(np.max(machine(bench).sensors["attitude"].noise, initial=0.0))
        return Messy(replace(secret, log=messed(secret.log, rng, noise)), share, rms)


def run(seed: int) -> dict[str, Any]:
    """Diagnose one case."""
    case = draw(seed)
    begin = time.process_time()
    found = diagnose([case.secret.log], case.secret.believed)
    row = scored(case, found)
    return row | {"seed": seed, "cpu": time.process_time() - begin}


def scored(case: Messy, found: Diagnosis) -> dict[str, Any]:
    """What a diagnosis said of a case."""
    labels = [cause.effect.label for cause in found.causes]
    first = set[str]()
    if found.causes:
        first = {labels[0], *(tie.label for tie in found.causes[0].ties)}
    inside, asked = 0, 0
    for cause in found.causes:
        for effect in case.secret.effects:
            if cause.effect.label == effect.label:
                known = np.isfinite(cause.half_widths) & amplitudes(effect)
                error = np.abs(cause.effect.values - effect.values)[known]
                inside += int(np.sum(error <= cause.half_widths[known]))
                asked += int(known.sum())
    torque = found.wander.torque
    return {
        "bench": case.secret.bench.words,
        "truth": case.truth,
        "share": case.share,
        "named": labels,
        "first": bool(set(case.truth) & first) if case.truth else not labels,
        "verdict": found.verdict,
        "inside": inside,
        "asked": asked,
        "rms": None if torque is None else torque.rms / case.rms,
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1, help="number of the first case")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with Pool(options.jobs) as pool:
        futures = [pool.submit(run, options.seed + i) for i in range(options.cases)]
        for future in as_completed(futures):
            row = future.result()
            rows.append(row)
            print(row, flush=True)
    for share in SHARES:
        own = [row for row in rows if row["share"] == share and row["truth"]]
        said = sum(row["verdict"] in ("explained", "ambiguous") for row in own)
        first = sum(row["first"] for row in own)
        print(f"wander {share}: {first} of {len(own)} named first, {said} explained or ambiguous")
    null = [row for row in rows if not row["truth"]]
    print(f"nothing hidden: {sum(not row['first'] for row in null)} of {len(null)} with a cause")
    inside, asked = (sum(row[key] for row in rows) for key in ("inside", "asked"))
    print(f"intervals: {inside} of {asked} hold")
    return 0


if __name__ == "__main__":
    sys.exit(main())
