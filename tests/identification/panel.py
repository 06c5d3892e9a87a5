"""Sixty logs a grade of noise, identified without being told the noise: are the intervals honest?

`python tests/identification/panel.py FOLDER [--logs 60] [--only middle,...]` flies and fits, one
JSON a fit, and prints the table; what is in FOLDER is not done again. The slow test runs it in
small.
"""

import argparse
import json
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from conftest import Campaign, fly_campaign, fly_machine
from score_columns import clock_lag, scale_factor

from twin import rotation
from twin.identification import identify
from twin.identification.identification import Identification
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.innovations import Problem, Unknowns
from twin.predict.logs import motion_of
from twin.predict.states import States
from twin.recording import Recording


@dataclass(frozen=True)
class Grade:
    """How noisy, how balanced, and how many logs are fitted together."""

    gyro: float = 0.0
    attitude: float = 0.0
    wheel_speed: float = 0.0
    vertical: float | None = None
    """Height of the CM above the CR [m]; None: as shipped."""
    together: int = 1
    commanded: bool = True
    """Whether the commands of the wheels are in the log."""
    machine: str = ""
    """Flown open loop with all that it has, its sensors as its platform has them; empty: `sads` in
    closed loop."""

    @property
    def stated(self) -> Platform:
        """Without a stop, whose push is predicted to no more than its softness, and without the
        shaking of stepper motors, which is not white."""
        platform = load_platform(self.machine or "sads")
        return replace(platform, tilt_limit=np.pi, pitch_stop=None, effects=())

    @property
    def noise(self) -> dict[str, float]:
        """1 sigma a sample, by stream."""
        if not self.machine:
            streams = ("gyro", "attitude", "wheel_speed")
            return {name: getattr(self, name) for name in streams}
        return {
            name: max(float(sensor.noise.max()), sensor.resolution / np.sqrt(12.0))
            for name, sensor in self.stated.sensors.items()
        }


GRADES = {
    "fine": Grade(1e-4, 1e-4, 0.02),
    "middle": Grade(1e-3, 1e-3, 0.1),
    "coarse": Grade(4.4e-3, 3.5e-2, 0.3),
    "fine-unstable": Grade(1e-4, 1e-4, 0.02, vertical=3e-4),
    "middle-unstable": Grade(1e-3, 1e-3, 0.1, vertical=3e-4),
    "coarse-unstable": Grade(4.4e-3, 3.5e-2, 0.3, vertical=3e-4),
    "middle-two-logs": Grade(1e-3, 1e-3, 0.1, together=2),
    "middle-no-command": Grade(1e-3, 1e-3, 0.1, commanded=False),
    **{name: Grade(machine=name) for name in ("tas2", "cubesat", "whorl1", "whorl2", "astros")},
}
PER_CAMPAIGN = 10
"""Logs that share one hidden base."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--logs", type=int, default=60)
    parser.add_argument("--duration", type=float, default=300.0)
    parser.add_argument("--only", default=",".join(GRADES))
    options = parser.parse_args()
    options.folder.mkdir(parents=True, exist_ok=True)
    for name in options.only.split(","):
        print(row(name, fits(name, options.logs, options.duration, options.folder)), flush=True)
    return 0


def fits(name: str, count: int, duration: float, folder: Path) -> list[dict]:
    """One result a fit; those in the folder are read."""
    grade, results = GRADES[name], []
    for seed in range(1000, 1000 + -(-count // PER_CAMPAIGN)):
        path = folder / f"{name}_{seed}.json"
        if not path.exists():
            campaign = campaign_of(grade, seed, duration)
            path.write_text(json.dumps(fit_all(campaign, grade)))
            print(f"{name}, seed {seed}", file=sys.stderr)
        results += json.loads(path.read_text())
    return results[: count // grade.together]


def campaign_of(grade: Grade, seed: int, duration: float) -> Campaign:
    """Its logs."""
    if grade.machine:
        return fly_machine(grade.stated, PER_CAMPAIGN, seed, duration)
    return fly_campaign(PER_CAMPAIGN, seed, duration, vertical=grade.vertical, **grade.noise)


def fit_all(campaign: Campaign, grade: Grade) -> list[dict]:
    """Every log, or every so many together."""
    results = []
    for first in range(0, len(campaign.logs), grade.together):
        logs = campaign.logs[first : first + grade.together]
        if not grade.commanded:
            logs = [without_commands(log) for log in logs]
        began = time.perf_counter()
        found = identify(logs, campaign.stated)
        took = time.perf_counter() - began
        total, least = found.misfit[0], bound(campaign, logs, grade)
        results.append(
            {
                "error": (found.theta[:9] - campaign.truth).tolist(),
                "half": found.half_widths[:9].tolist(),
                "covariance": found.covariance[:9, :9].tolist(),
                "bound": np.sqrt(np.diag(least)).tolist(),
                "least": least.tolist(),
                "chi2": total.chi2_per_sample,
                "inside": total.low <= total.chi2_per_sample <= total.high,
                "scores": scores(found, logs).tolist(),
                "converged": found.fit is not None and found.fit.converged,
                "seconds": took,
            }
        )
    return results


def without_commands(log: Recording) -> Recording:
    """The same log, had nobody recorded what drove the wheels."""
    kept = {n: s for n, s in log.items() if not n.startswith(("command_wheel", "wanted_wheel"))}
    return Recording(kept, log.provenance)


def bodies_of(found: Identification, logs: list[Recording]) -> list[Body]:
    machine = compile_model(found.platform)
    return [body_of(machine, log, motion_of(log, found.platform)) for log in logs]


def scores(found: Identification, logs: list[Recording]) -> np.ndarray:
    """Score tests of a clock lag of the wheel speed, without one of the attitude, and of the gyro
    scales, each N(0, 1)."""
    assert found.fit is not None
    now = found.fit.innovations
    bodies = bodies_of(found, [log.without_truth() for log in logs])
    model = found.base.model(now.at.theta)
    columns = []
    for body, start in zip(bodies, now.at.starts, strict=True):
        path = body.rollouts.paths(model, start.batched())
        late = "wheel_speed" if body.inputs.wheels_predicted else "attitude"
        columns.append(
            np.concatenate([clock_lag(body, path, late), scale_factor(body, path, "gyro")], axis=-1)
        )
    values = []
    problem = Problem(bodies, found.base)
    for column in range(columns[0].shape[-1]):
        one = problem.with_columns(now, [c[..., column : column + 1] for c in columns])
        values.append(one.step()[-1] / np.sqrt(one.covariance[-1, -1]))
    return np.array(values)


def bound(campaign: Campaign, logs: list[Recording], grade: Grade) -> np.ndarray:
    """(9, 9) Cramer-Rao bound: at the true base, along the true path, the noise as it is.

    Along the path, because what an unstable machine shows of its base depends on where it went: a
    few degrees of noise in the states make the bound several times too small.
    """
    facts = {"streams": {name: {"noise": sigma} for name, sigma in grade.noise.items()}}
    machine = compile_model(campaign.stated)
    base = base_parameters(machine)
    told = [replace(log.without_truth(), provenance=facts) for log in logs]
    bodies = [body_of(machine, log, motion_of(log, campaign.stated)) for log in told]
    at = Unknowns(
        campaign.truth,
        tuple(np.zeros(len(body.bias_scale)) for body in bodies),
        tuple(true_states(log, body.grid.starts) for log, body in zip(logs, bodies, strict=True)),
        strengths=np.zeros(0),
    )
    return Problem(bodies, base).innovations(at).covariance[:9, :9]


def true_states(log: Recording, times: np.ndarray) -> States:
    """Where a simulated machine was."""
    names = ("truth_attitude", "truth_rate", "truth_wheel_speed", "gimbal_angle")
    attitude, rate, wheel_speed, gimbal_angle = (
        log[name].interpolated_at(times) if name in log else np.zeros((len(times), 0))
        for name in names
    )
    return States(rotation.normalized(attitude), rate, wheel_speed, gimbal_angle)


def row(name: str, results: list[dict]) -> str:
    """A line of the table."""
    error, half = (np.array([r[key] for r in results]) for key in ("error", "half"))
    bounds = np.array([r["bound"] for r in results])
    score = np.array([r["scores"] for r in results])
    covered = np.abs(error) <= half
    efficiency = np.sqrt(np.mean(np.square(error / bounds), axis=0))
    return (
        f"{name}: {len(results)} fits, covered {covered.mean():.1%} "
        f"(each parameter {covered.mean(axis=0).min():.0%} to {covered.mean(axis=0).max():.0%}), "
        f"rms error / Cramer-Rao {np.sqrt(np.mean(np.square(error / bounds))):.2f} "
        f"(worst {efficiency.max():.2f}), "
        f"chi2 per sample {np.mean([r['chi2'] for r in results]):.4f} "
        f"inside its band {np.mean([r['inside'] for r in results]):.0%}, "
        f"scores rms lag {np.sqrt(np.mean(score[:, 0] ** 2)):.2f} "
        f"scale {np.sqrt(np.mean(score[:, 1:] ** 2)):.2f} "
        f"beyond 3 sigma {np.mean(np.abs(score) > 3.0):.1%}, "
        f"converged {np.mean([r['converged'] for r in results]):.0%}, "
        f"{np.median([r['seconds'] for r in results]):.1f} s a fit"
    )


if __name__ == "__main__":
    sys.exit(main())
