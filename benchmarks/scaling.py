"""What a campaign's cost grows with: runs of a shard, seconds of a run, effects.

One process, one thread. Each curve is measured in rounds over all of its points, so that what
others do to the machine meanwhile falls on all of them; the median over the rounds is printed.
"""

from collections.abc import Callable, Sequence
from functools import partial

from benchmarks.campaign import SADS, SADS_OFFSET, Case, spec_of
from benchmarks.measure import median, seconds, spread, table
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.spec import Spec

ROUNDS = 3
SHARDS = (2, 4, 16, 64, 256, 1024, 4096)
"""Runs of one."""
DURATIONS = (2.0, 6.0, 20.0, 60.0, 200.0)
"""[s]"""
OF_SHARDS, OF_DURATIONS, OF_EFFECTS = 6.0, 64, 6.0
"""Seconds of a run while the shard grows; runs while they grow longer; seconds with effects."""
ADDED = (0, 1, 2, 4, 8, 12, 16)
"""Effects that are dispersed."""
EFFECTS = (
    "gyro_bias",
    "bearing_viscous_friction",
    "gyro_scale_factor",
    "structural_sag",
    "attitude_misalignment",
    "wheel_friction",
    "harness_stiffness",
    "gyro_misalignment",
    "bearing_swirl_torque",
    "wheel_misalignment",
    "gyro_drift",
    "center_of_mass_drift",
    "wheel_inertia_error",
    "aerodynamic_drag",
    "wheel_torque_gain",
    "bearing_coulomb_friction",
)
"""In the order in which they are added: of sensors, of the model, of torques in turn."""


def run() -> None:
    """Print the three curves."""
    case = Case("", *SADS, "filter", rest=SADS_OFFSET)
    print(f"CM dispersed, attitude filter; medians of {ROUNDS} rounds (lowest to highest).\n")
    _curve(
        f"runs of a shard, of {OF_SHARDS:g} s each",
        [(f"{runs}", spec_of(case, runs, OF_SHARDS)) for runs in SHARDS],
    )
    _curve(
        f"seconds of a run, {OF_DURATIONS} runs",
        [(f"{duration:g}", spec_of(case, OF_DURATIONS, duration)) for duration in DURATIONS],
    )
    _curve(
        f"effects dispersed, 256 runs of {OF_EFFECTS:g} s",
        [(f"{count}", spec_of(_with(count), 256, OF_EFFECTS)) for count in ADDED],
    )
    print("Effects, in the order in which they were added: " + ", ".join(EFFECTS) + ".")


def _with(count: int) -> Case:
    tables = "".join(f"[effects.{_targeted(name)}]\n" for name in EFFECTS[:count])
    return Case("", *SADS, "filter", rest=SADS_OFFSET + tables)


def _targeted(name: str) -> str:
    return f"{name}.w1" if name.startswith("wheel_") else name


def _curve(of: str, points: Sequence[tuple[str, Spec]]) -> None:
    jobs = [_job(spec) for _, spec in points]
    took: list[list[float]] = [[] for _ in jobs]
    for turn in range(ROUNDS + 1):
        for job, own in zip(jobs, took, strict=True):
            once = seconds(job)
            if turn:  # the first one imports and compiles
                own.append(once)
    rows: list[list[str]] = []
    for (name, spec), own in zip(points, took, strict=True):
        ticks = spec.duration / spec.arms[0].platform.tick
        each = [once * 1e6 / (ticks * spec.runs) for once in own]
        factors = len(spec.dispersed)
        rows.append(
            [name, f"{factors}", f"{median(own):.3g}", spread(each, ".1f"),
             f"{spec.runs * spec.duration / median(own):.0f}"]
        )  # fmt: skip
    table((of, "numbers drawn", "seconds", "us a run and tick", "simulated s per s"), rows)
    print()


def _job(spec: Spec) -> Callable[[], object]:
    return partial(flown, spec, draw(spec, range(spec.runs)))
