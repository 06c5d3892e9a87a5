"""Gains of a control law, tuned over the dispersions of a campaign.

Every set of gains flies the same dispersed machines with the same noise (common random numbers), so
that sets differ by their gains alone. SciPy's differential evolution searches the logarithms of the
gains. The best of many is the best of noise, too: so what counts are runs that took no part in the
search, flown with the gains as they were and as tuned, and the 95 % interval of the paired
difference. Gains are proposed only where that interval is on the better side of 0.

R. Storn and K. Price, Journal of Global Optimization 11 (1997); common random numbers: A. M. Law,
Simulation Modeling and Analysis, chapter 11.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import differential_evolution
from scipy.stats import t as student

from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.merit import METRICS
from twin.campaigns.read import gain_fields, read_spec
from twin.campaigns.spec import Spec
from twin.controller import load_controller
from twin.errors import UnknownName, UsageError
from twin.interval import Interval
from twin.platform import Platform, load_platform
from twin.shown import Shown

Array = NDArray[np.float64]
Say = Callable[[str], None]
WIDEST = 10.0
"""Factor by which a gain may rise or fall."""
LOST = 1e3
"""Merit of a run that fails or loses its law, in worst merits of the usual gains."""
TILT = 0.05
"""1 sigma of roll, pitch and yaw at the start, where no campaign is given [rad],"""
STOP_SHARE = 0.1
"""or this share of the way to the machine's stop, where that is less."""
OFFSET = 0.3
"""1 sigma of each component of m r, as a share of its length."""


@dataclass(frozen=True)
class GainTrial:
    """One set of gains."""

    gains: Mapping[str, float]
    merit: float
    """Mean over the runs of the search; less is better."""


@dataclass(frozen=True)
class Tuning(Shown):
    """Gains that were sought, and what they are worth on runs that took no part."""

    platform: Platform
    law: str
    merit: str
    """A campaign's metric."""
    unit: str
    runs: int
    """Of the search,"""
    held_out: int
    """and held out."""
    duration: float
    """Of each [s]."""
    usual: Mapping[str, float]
    """The gains as they were."""
    tuned: Mapping[str, float]
    trials: tuple[GainTrial, ...]
    before: float
    """Mean merit of the held-out runs, with the usual gains,"""
    after: float
    """and as tuned."""
    difference: Interval
    """After less before, paired; NaN where runs failed with either."""
    lost: tuple[int, int]
    """Held-out runs that failed, with the usual gains and as tuned."""

    @property
    def better(self) -> bool:
        """Whether the tuned gains are better on the held-out runs beyond chance."""
        if self.lost[1] != self.lost[0]:
            return self.lost[1] < self.lost[0]
        return self.difference.high < 0.0


def tune(
    law: str | Path,
    platform: str | Path | Platform,
    *,
    spec: str | Path | None = None,
    gains: Sequence[str] = (),
    merit: str = "tracking_error_rms",
    runs: int = 24,
    held_out: int = 48,
    evaluations: int = 60,
    duration: float = 30.0,
    seed: int = 0,
    say: Say = lambda _: None,
) -> Tuning:
    """Gains of a law over the dispersions of a campaign, judged on runs that took no part.

    Args:
        law: a shipped law by its name, or a file.
        platform: the machine.
        spec: a campaign's file, of which the dispersions, starts, reference and duration are taken;
            None: starts and m r spread about the machine as stated.
        gains: which; none: all that are not 0.
        merit: the campaign's metric whose mean is minimised.
        runs: of the search.
        held_out: of the judgement.
        evaluations: sets of gains that are flown.
        duration: of a run, where `spec` is None [s].
        seed: of the search, and of the dispersions where `spec` is None.
        say: takes each step.

    Raises:
        UnknownName: no such law, gain or metric.
        UsageError: a law without gains, or numbers that are too small.
        CampaignError: a specification that cannot be used.
    """
    for name, value, low in (
        ("runs", runs, 4),
        ("held_out", held_out, 8),
        ("evaluations", evaluations, 8),
    ):
        if value < low:
            raise UsageError(f"{name} is {value}; give {low} or more")
    if merit not in METRICS:
        raise UnknownName("metric", merit, METRICS)
    if METRICS[merit].worse == 0:
        raise UsageError(f"{merit} is neither better nor worse for being larger; give another")
    machine = platform if isinstance(platform, Platform) else load_platform(str(platform))
    campaign = _campaign(str(law), machine, spec, duration, seed, merit)
    usual = _usual(str(law), gains)
    study = _Search(campaign, merit, range(runs), say)
    first = study.merit(usual)
    if not np.isfinite(first):
        raise UsageError(f"{law} on {machine.name} fails in every run; nothing can be tuned")
    names, start = list(usual), np.log(np.abs(list(usual.values())))
    signs = np.sign(list(usual.values()))
    reach = np.log(WIDEST)
    members = max(min(3 * len(names), evaluations // 3), 5)
    rng = np.random.default_rng(seed)
    begin = start + rng.uniform(-reach, reach, (members, len(names))) * 0.7

    def criterion(numbers: Array) -> float:
        return study.merit(dict(zip(names, (signs * np.exp(numbers)).tolist(), strict=True)))

    differential_evolution(
        criterion,
        [(x - reach, x + reach) for x in start.tolist()],
        init=begin,
        maxiter=max(round(evaluations / members) - 1, 1),
        polish=False,
        tol=0.0,
        seed=np.random.default_rng(seed + 1),
    )
    best = min(study.trials, key=lambda trial: trial.merit)
    say("the held-out runs")
    judged = range(runs, runs + held_out)
    before, lost_before = _flown(campaign, merit, judged, usual)
    after, lost_after = _flown(campaign, merit, judged, best.gains)
    both = ~lost_before & ~lost_after
    pairs = after[both] - before[both]
    half = np.nan
    if len(pairs) > 1:
        spread = float(np.std(pairs, ddof=1) / np.sqrt(len(pairs)))
        half = float(student.ppf(0.975, len(pairs) - 1)) * spread
    middle = float(pairs.mean()) if len(pairs) else np.nan
    return Tuning(
        machine,
        str(law),
        merit,
        METRICS[merit].unit,
        runs,
        held_out,
        campaign.duration,
        usual,
        best.gains,
        tuple(study.trials),
        float(before[both].mean()) if both.any() else np.nan,
        float(after[both].mean()) if both.any() else np.nan,
        Interval(middle, middle - half, middle + half),
        (int(lost_before.sum()), int(lost_after.sum())),
    )


def _usual(law: str, gains: Sequence[str]) -> dict[str, float]:
    """The gains that are sought, as the law has them."""
    loaded = load_controller(law)
    known = {
        name: float(value)
        for name in gain_fields(loaded)
        if isinstance(value := getattr(loaded, name), int | float) and not isinstance(value, bool)
    }
    for name in gains:
        if name not in known:
            raise UnknownName(f"gain of {law}", name, known)
        if known[name] == 0.0:
            raise UsageError(f"{name} of {law} is 0, and a search by factors leaves it there")
    result = {name: known[name] for name in (gains or known) if known[name] != 0.0}
    if not result:
        raise UsageError(f"{law} has no gain to tune")
    return result


def _campaign(
    law: str, platform: Platform, spec: str | Path | None, duration: float, seed: int, merit: str
) -> Spec:
    """The campaign whose dispersions are flown, with this law on this machine alone."""
    if spec is not None:
        read = read_spec(Path(spec))
        if read.procedure != "run":
            raise UsageError(f"{spec} is of balancings; gains of a law are tuned in runs")
        arm = replace(read.arms[0], controller=law, gains={})
        if arm.platform.folder.resolve() != platform.folder.resolve():
            raise UsageError(
                f"{spec} is of {arm.platform.name}, not of {platform.name}; name its machine"
            )
        return _measured(replace(read, arms=(arm,), gains=()), merit)
    text = _usual_campaign(law, platform, duration, seed)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "tune.toml"
        path.write_text(text, encoding="utf-8")
        return _measured(read_spec(path), merit)


def _measured(spec: Spec, merit: str) -> Spec:
    if merit not in spec.metrics:
        raise UsageError(
            f"{merit} is no metric of these runs; give one of {', '.join(spec.metrics)}"
        )
    return replace(spec, metrics=(merit,))


def _usual_campaign(law: str, platform: Platform, duration: float, seed: int) -> str:
    """A campaign's file: starts and m r spread about the machine as stated."""
    name = f"{platform.folder}"
    _, colon, variant = platform.name.partition(":")
    lines = [
        f'platform = "{name}{colon}{variant}"',
        f'controller = "{law}"',
        "runs = 1000000",
        f"duration = {duration!r}",
        f"seed = {seed}",
        "[initial]",
    ]
    if platform.base.kind == "hinge":
        return "\n".join([*lines, f"joint_angle = {{ normal = [0.0, {TILT}] }}"]) + "\n"
    sigma = min(TILT, STOP_SHARE * float(platform.stop_angle))
    lines.append(f"attitude = {{ normal = [0.0, {sigma!r}] }}")
    size = OFFSET * float(np.linalg.norm(platform.center_of_mass_offset))
    if size > 0.0:
        mean = ", ".join(f"{value!r}" for value in platform.center_of_mass_offset.tolist())
        lines.append(
            f"center_of_mass_offset = {{ normal = [[{mean}], [{size!r}, {size!r}, {size!r}]] }}"
        )
    return "\n".join(lines) + "\n"


class _Search:
    """Trials of sets of gains on the same runs."""

    def __init__(self, campaign: Spec, merit: str, runs: Sequence[int], say: Say) -> None:
        self.trials: list[GainTrial] = []
        self._campaign, self._merit, self._runs, self._say = campaign, merit, runs, say
        self._worst = np.nan

    def merit(self, gains: Mapping[str, float]) -> float:
        """Mean over the runs; of those that fail, far beyond the worst."""
        values, lost = _flown(self._campaign, self._merit, self._runs, gains)
        if np.isnan(self._worst):
            if lost.all():
                return np.inf
            self._worst = float(np.max(np.abs(values[~lost])))
        mean = float(np.mean(np.where(lost, LOST * self._worst, values)))
        self.trials.append(GainTrial(dict(gains), mean))
        best = min(trial.merit for trial in self.trials)
        self._say(f"set {len(self.trials)}: {self._merit} {mean:.4g}, the best so far {best:.4g}")
        return mean


def _flown(
    campaign: Spec, merit: str, runs: Sequence[int], gains: Mapping[str, float]
) -> tuple[Array, NDArray[np.bool_]]:
    """(n,) the metric of each run, the better the smaller, and which runs have none."""
    arm = replace(campaign.arms[0], gains=dict(gains))
    came = flown(replace(campaign, arms=(arm,)), draw(campaign, list(runs)))
    sign = 1.0 if METRICS[merit].worse >= 0 else -1.0
    values = np.array([sign * came[run].metrics[merit] for run in runs])
    lost = np.array([came[run].ended == "failed" for run in runs]) | ~np.isfinite(values)
    return values, lost
