"""Balancing as a control law with phases: it goes through the one loop, a run or a thousand."""

from dataclasses import dataclass, field, fields, is_dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from twin.controller import AnyController, Controller
from twin.platform import Platform
from twin.procedures.fits import MomentFit
from twin.procedures.logbook import Lab
from twin.procedures.means import Reach, damper, mean_inertia
from twin.procedures.plan import MARGIN, OVER, Aim, Phase, among, observed_torque, state
from twin.reference import Hold, Reference
from twin.rotation import vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]


CLEAR = 0.5
"""Part of the way to the stop within which the body is clear of it."""
NEAR = 0.9
"""Part of that way beyond which the stop may touch: what is recorded there is worth nothing."""
STILL = 0.6
"""Of the rate that a nudge gives: a body that is slower has come to rest."""
SMALLEST_RATE = 1e-3
"""Smallest rate that a phase waits for [rad/s]."""
NUDGED = 4.0
"""For which the masses stand aside at most [s]."""
CROSSWISE = 0.6
"""Of a nudge, in parts of that along: both horizontal axes are to swing."""
ARRIVED = 5e-5
"""[m]: a mass so near to its goal is there, but for its play."""


@dataclass(frozen=True)
class Kit:
    """One platform and the laws that act on it."""

    platform: Platform
    reach: Reach
    laws: dict[str, AnyController]

    def lean(self, estimate: Estimate) -> Array:
        """(n,) towards the stop, in parts of the way to it."""
        stop = min(self.platform.stop_angle, 0.5 * np.pi)
        return self.platform.lean(estimate.attitude) / stop

    def away(self, goal: Array, estimate: Estimate) -> Mask:
        """(n,) whether a mass is not yet where it is to be, (n, stages) [m]."""
        return np.abs(estimate.stage_position - goal).max(axis=1) > ARRIVED

    def across(self, rate: Array, estimate: Estimate) -> Array:
        """(n,) of a body rate (n, 3), what is not a turn about the vertical [rad/s]."""
        up = vertical_body(estimate.attitude)
        along = np.einsum("ni,ni->n", rate, up)[:, None] * up
        return np.asarray(np.linalg.norm(rate - along, axis=1))

    def still(self, amplitude: Array, stiffness: Array) -> Array:
        """(n,) rate below which the body has come to rest [rad/s]."""
        return STILL * np.maximum(amplitude * self.frequency(stiffness), SMALLEST_RATE)

    def aside_for(self, stiffness: Array) -> Array:
        """(n,) for how long a nudge lasts [s]: a sixth of a period or less."""
        return np.minimum(NUDGED, 1.0 / self.frequency(stiffness))

    def nudge(self, goal: Array, amplitude: Array, stiffness: Array) -> Array:
        """(n, stages) where masses at `goal` go aside, to make the body swing by the amplitude.

        A mass moment d for a time T turns a body at rest to the rate g d T / J, and that is the
        amplitude times sqrt(k / J). Towards the middle of each travel; never up or down.
        """
        rate = amplitude * self.frequency(stiffness)
        impulse = rate * mean_inertia(self.platform)
        size = impulse / (self.platform.gravity * self.aside_for(stiffness))
        low, high = self.reach.masses.travel
        inward = self.reach.moment(0.5 * (low + high) - goal)
        sign = np.where(inward < 0.0, -1.0, 1.0)
        aside = sign * size[:, None] * np.array([1.0, CROSSWISE, 0.0])
        return np.clip(goal + self.reach.masses.positions(aside), low, high)

    def frequency(self, stiffness: Array) -> Array:
        """(n,) sqrt(k / J) of the hanging body [rad/s]."""
        return np.sqrt(stiffness / mean_inertia(self.platform))


@dataclass
class BalancingProgress:
    """Arrays have a row a run."""

    phase: NDArray[np.int64]
    """(n,) of `Phase`."""
    since: Array
    """(n,) when it began [s]."""
    moving_until: Array
    """(n,) time at which the body last moved too much for the next phase [s]."""
    swinging_until: Array
    """(n,) time of its last swing [s]."""
    away_until: Array
    """(n,) time at which a mass was last away from its goal [s]."""
    rate: Array
    """(n, 3) of the body, smoothed [rad/s]."""
    goal: Array
    """(n, stages) where the masses are to be [m]."""
    smooth: Array
    """(n, stages) where the law of the level phase has them, its noise averaged out [m]."""
    rest: Array
    """(n, stages) where they go back to after a nudge [m]."""
    stiffness: Array
    """(n,) -g m r_z: of the hanging body, as far as it is known [N m/rad]."""
    amplitude: Array
    """(n,) swing that a nudge is to give [rad]."""
    watch: Array
    """(n,) how long the next swing is recorded [s]."""
    tries: NDArray[np.int64]
    """(n,) looks at the present offset."""
    rounds: NDArray[np.int64]
    """(n,) offsets identified."""
    base: Array
    """(n, 3) m r at stage position 0, as far as it is known [kg m]."""
    levelled: Mask
    """(n,) whether the law of the level phase has had its turn in this round."""
    log_start: Array
    """(n,) from when on the log is needed [s]; inf: not."""
    estimated: Mask
    """(n,) whether the masses' first positions are known."""
    kit: Kit
    states: dict[str, Any]
    """Of the laws that act, by what they are for."""

    @classmethod
    def start(cls, kit: Kit, n: int, states: dict[str, Any]) -> "BalancingProgress":
        """Before the first tick."""
        stages = len(kit.platform.stages)
        return cls(
            phase=np.full(n, Phase.lower, dtype=np.int64),
            since=np.zeros(n),
            moving_until=np.zeros(n),
            swinging_until=np.zeros(n),
            away_until=np.zeros(n),
            rate=np.zeros((n, 3)),
            goal=np.zeros((n, stages)),
            smooth=np.zeros((n, stages)),
            rest=np.zeros((n, stages)),
            stiffness=np.zeros(n),
            amplitude=np.zeros(n),
            watch=np.zeros(n),
            tries=np.zeros(n, dtype=np.int64),
            rounds=np.zeros(n, dtype=np.int64),
            base=np.zeros((n, 3)),
            levelled=np.zeros(n, dtype=np.bool_),
            log_start=np.full(n, np.inf),
            estimated=np.zeros(n, dtype=np.bool_),
            kit=kit,
            states=states,
        )

    def copied(self) -> "BalancingProgress":
        """Another that may be written to."""
        arrays = {
            f.name: getattr(self, f.name).copy()
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        return replace(self, **arrays, states=dict(self.states))

    def within(self, *phases: Phase) -> Mask:
        """(n,) the runs in one of these phases."""
        return among(self.phase, phases)

    def only(self, run: int) -> Mask:
        """(n,) that run alone."""
        item = np.zeros(len(self.phase), dtype=np.bool_)
        item[run] = True
        return item

    @property
    def finished(self) -> Mask:
        """(n,) the runs that are over."""
        return self.within(*OVER)


def renewed(state: Any, fresh: Any, rows: Mask) -> Any:
    """A law's state with some runs as they were before their first tick.

    What is no array with a row a run is the same in both, and stays.
    """
    if not is_dataclass(state) or isinstance(state, type):
        return state
    changes: dict[str, Any] = {}
    for entry in fields(state):
        old, new = getattr(state, entry.name), getattr(fresh, entry.name)
        if isinstance(old, np.ndarray) and old.shape[:1] == rows.shape:
            which = rows.reshape(-1, *[1] * (old.ndim - 1))
            changes[entry.name] = np.where(which, new, old)
    return replace(state, **changes)


def put(command: Command, part: Command, rows: Mask) -> None:
    """Write some runs' part of a law's command into a command that has all channels."""
    for name, value in part.items():
        command[name] = np.where(rows[:, None], value, command[name])


TRIES = 4
"""Looks at one offset, one after the other, before giving up."""
ROUNDS = 40
"""Offsets identified before giving up."""
SHORTEST = 30.0
"""That a swing is recorded [s]."""
PERIODS = 0.6
"""Of the swing that are recorded."""
LONGEST = 120.0
"""That a swing is recorded at first [s]; each further look at the same offset takes twice as long.
"""


@dataclass(frozen=True)
class Next:
    """Of one run."""

    phase: Phase
    words: str = ""
    """Why, where it is not as it should be."""
    goal: Array | None = None
    """(stages,) where its masses go [m]."""


def conclude(
    lab: Lab,
    aim: Aim,
    progress: BalancingProgress,
    run: int,
    fit: MomentFit,
    positions: Array,
    *,
    in_plane: bool,
    time: float,
) -> Next:
    """What a run does next; how it swings from now on is written into `progress`.

    Args:
        lab: of the procedure.
        aim: of the procedure.
        progress: of all runs.
        run: that was identified.
        fit: what was.
        positions: (stages,) where its masses stand [m].
        in_plane: whether the masses move the CM in the plane, rather than a law.
        time: [s].
    """
    if fit.failure:
        progress.watch[run] *= 2.0
        return Next(Phase.settle, fit.failure)
    kit = progress.kit
    moment = fit.moment + kit.reach.moment(positions[None])[0]
    progress.rounds[run] += 1
    progress.base[run] = fit.moment
    _tell(lab, progress, run, moment, fit, time)
    if progress.phase[run] == Phase.judge:
        platform, (_, floated) = kit.platform, lab.logs[run]
        observed = observed_torque(floated, platform, fit.inertia)
        lab.notes.runs[run].statement = state(
            platform, moment, fit.covariance, fit.quantile, observed, positions, fit.misfit
        )
    kept = aim.is_kept(moment, fit.covariance, fit.quantile)
    change = aim.change(moment, fit.covariance, in_plane=in_plane)
    goal = positions + kit.reach.masses.positions(change[None])[0]
    beyond = kit.reach.beyond(goal)
    last = progress.rounds[run] >= ROUNDS
    if kept and (beyond or last or not aim.is_worth(change)):
        return Next(Phase.done if progress.phase[run] == Phase.judge else Phase.verify)
    if not aim.is_known(moment, fit.covariance):
        progress.watch[run] *= 2.0
        return Next(Phase.settle, "the swing does not identify the offset well enough")
    if last:
        return Next(Phase.stopped, f"the target was not reached in {ROUNDS} rounds")
    if beyond:
        return Next(Phase.stopped, f"the offset is beyond the masses' reach: {beyond}")
    hanging = max(-float(moment[2] + change[2]), MARGIN * aim.moment)
    progress.stiffness[run] = kit.platform.gravity * hanging
    period = 2.0 * np.pi / float(kit.frequency(progress.stiffness)[run])
    progress.watch[run] = np.clip(PERIODS * period, SHORTEST, LONGEST)
    progress.tries[run] = 0
    return Next(Phase.move, goal=goal)


def _tell(
    lab: Lab, progress: BalancingProgress, run: int, moment: Array, fit: MomentFit, time: float
) -> None:
    platform = progress.kit.platform
    offset, half = (
        v / platform.mass * 1e6 for v in (moment, fit.quantile * np.sqrt(np.diag(fit.covariance)))
    )
    torque = platform.gravity * float(np.linalg.norm(moment))
    lab.notes.runs[run].identified += 1
    lab.notes.say(
        run,
        time,
        "the CM is ("
        + ", ".join(f"{o:.4g} +- {h:.2g}" for o, h in zip(offset, half, strict=True))
        + f") um from the CR, {torque:.3g} N m at worst",
    )


STRONG, WEAK = 0.3, 0.01
"""Damping while nothing is recorded, and while the body swings [1/s]."""
SWING = np.radians(4.0)
"""That a nudge is to give [rad], or an eighth of the way to the stop."""
SMOOTHED = 2.0
"""Over which the rate is averaged at least [s]."""
SLOWLY = 0.25
"""And at least over so much of a swing [rad]: a body that swings slowly is at rest at rates that a
noisy gyro hardly shows."""
SETTLED = 2e-3
"""[rad/s]: a body that leans and turns no faster hangs there, or lies on its stop."""
HELD_FOR = 1.0
"""For which the masses have been where they are to be [s]."""
REST = 5.0
"""For which the body has been still [s]."""
PATIENCE = 900.0
"""In which masses must arrive and the body must come to rest [s]."""
FLOAT = 124.0
"""Recorded free float [s], of which 120 s count for the torque that is observed."""
THINKING = 2.0
"""That the body is held at least while a fit runs [s]."""

GUESSES = np.array([1.0, 2.0, 0.5, 0.25])
"""Sizes of an m r that nobody knows, to begin the first fit from; in parts of what the masses at
their lower end give alone."""

AVERAGED = 0.125
"""Of the level phase over which the masses' places are averaged: at any instant its law has them
where the gyro's noise wants them, too, and there they would stay."""

DAMPED = (Phase.lower, Phase.settle, Phase.identify, Phase.move, Phase.judge)
SWINGING = (Phase.nudge, Phase.back, Phase.swing)
WAITING = (Phase.lower, Phase.settle, Phase.nudge, Phase.back, Phase.move)


@dataclass(frozen=True)
class Balancing(Controller[BalancingProgress]):
    """Lower, settle, [level], nudge, swing, identify, move ... until the target holds; verify.

    Each round identifies J and m r from a recorded swing and moves the masses to cancel what was
    found: in the plane at once (paper 000 of docs/design.md, eq. 12 to 15, iterated as in 004), in
    height from below (`twin.procedures.plan`). With `level`, a control law has its turn before the
    rounds that follow the first: of 001 or 003 in the plane, or the adaptive one of 000.

    A body that hangs with the stiffness k = -g m r_z swings at sqrt(k / J). A nudge moves masses
    aside for a time and back, and so makes it swing wherever it hangs.
    """

    aim: Aim
    lab: Lab
    level: AnyController | None = None
    """The law of the level phase; None: no such phase."""
    level_reference: Reference = field(default_factory=Hold)
    """What it follows, from the start of its phase."""
    level_for: float = 240.0
    """How long it is given [s]."""
    level_once: bool = False
    """Whether it has its turn once, and the rounds go on without it; else it alone moves the CM in
    the plane."""

    def init(self, platform: Platform, n: int) -> BalancingProgress:
        """Nothing known; the stiffness taken is that of masses at their lower end.

        Raises:
            ControllerError: the machine has no stages for it, or nothing that damps.
        """
        laws = {"strong": damper(platform, STRONG), "weak": damper(platform, WEAK)}
        if self.level is not None:
            laws["level"] = self.level
        reach = Reach.of(platform)
        states = {name: law.init(platform, n) for name, law in laws.items()}
        progress = BalancingProgress.start(Kit(platform, reach, laws), n, states)
        progress.amplitude[:] = min(SWING, 0.125 * platform.stop_angle)
        progress.watch[:] = SHORTEST
        progress.stiffness[:] = platform.gravity * reach.depth
        return progress

    def finished(self, state: BalancingProgress) -> Mask:
        """(n,) the runs that are balanced or stopped."""
        return state.finished

    def update(
        self, state: BalancingProgress, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, BalancingProgress]:
        """The phases' commands, and the phases after this tick."""
        progress = state.copied()
        self._begin(progress, estimate, time)
        self._watch(progress, estimate, time)
        self._advance(progress, estimate, time)
        command = self._command(progress, estimate, target, time)
        self.lab.logbook.forget(float(np.min(progress.log_start, initial=np.inf)))
        return command, progress

    def _begin(self, progress: BalancingProgress, estimate: Estimate, time: float) -> None:
        """Runs that are seen for the first time: their vertical mass goes to its lower end."""
        fresh = estimate.valid & ~progress.estimated
        if not fresh.any():
            return
        lowest = progress.kit.reach.lowest(estimate.stage_position)
        progress.goal = np.where(fresh[:, None], lowest, progress.goal)
        progress.estimated = progress.estimated | fresh
        self._enter(progress, fresh, Phase.lower, time)

    def _watch(self, progress: BalancingProgress, estimate: Estimate, time: float) -> None:
        """What the conditions of the phases look at."""
        kit = progress.kit
        averaged = np.maximum(SMOOTHED, SLOWLY / kit.frequency(progress.stiffness))
        share = np.minimum(kit.platform.tick / averaged, 1.0)[:, None]
        progress.rate = progress.rate + share * (estimate.rate_body - progress.rate)
        across = kit.across(progress.rate, estimate)
        moving = (across > kit.still(progress.amplitude, progress.stiffness)) | (
            kit.lean(estimate) > CLEAR
        )
        away = kit.away(progress.goal, estimate)
        progress.swinging_until = np.where(across > SETTLED, time, progress.swinging_until)
        progress.moving_until = np.where(
            moving, time, np.maximum(progress.moving_until, progress.since)
        )
        progress.away_until = np.where(away, time, np.maximum(progress.away_until, progress.since))

    def _advance(self, progress: BalancingProgress, estimate: Estimate, time: float) -> None:
        """From phase to phase; every run at most once a tick."""
        kit, was, lasted = progress.kit, progress.phase.copy(), time - progress.since
        arrived = progress.estimated & (time - progress.away_until > HELD_FOR)
        still = time - progress.moving_until > REST
        touching = kit.lean(estimate) > NEAR

        self._enter(progress, (was == Phase.lower) & arrived, Phase.settle, time)
        rested = (was == Phase.settle) & still & arrived
        levelling = rested & (progress.rounds > 0) & ~progress.levelled & (self.level is not None)
        self._level(progress, levelling, time)
        self._nudge(progress, rested & ~levelling, estimate, time)
        over = (was == Phase.level) & (lasted > self.level_for)
        if not self.level_once:
            progress.goal = np.where(over[:, None], progress.smooth, progress.goal)
        progress.levelled = progress.levelled | over
        self._enter(progress, over, Phase.settle, time)
        aside = (
            (was == Phase.nudge) & arrived & (lasted > HELD_FOR + kit.aside_for(progress.stiffness))
        )
        progress.goal = np.where(aside[:, None], progress.rest, progress.goal)
        self._enter(progress, aside, Phase.back, time)
        self._record(progress, (was == Phase.back) & arrived, Phase.swing, time)

        recorded = (was == Phase.swing) | (was == Phase.verify)
        for run in np.flatnonzero(recorded & touching):
            progress.amplitude[run] *= 0.5
            self._again(progress, int(run), "it swings so far that the stop may touch", time)
        long_enough = np.where(was == Phase.verify, FLOAT, progress.watch)
        for run in np.flatnonzero(recorded & ~touching & (lasted >= long_enough)):
            self._ask(progress, int(run), time)
        fitting = (was == Phase.identify) | (was == Phase.judge)
        for run in np.flatnonzero(fitting & (lasted >= THINKING)):
            self._answered(progress, int(run), estimate, time)
        self._enter(progress, (was == Phase.move) & arrived, Phase.settle, time)
        late = among(was, WAITING) & (progress.phase == was) & (lasted > PATIENCE)
        for run in np.flatnonzero(late):
            self._stop(progress, int(run), _unrest(progress, int(run), estimate), estimate, time)

    def _command(
        self, progress: BalancingProgress, estimate: Estimate, target: Target, time: float
    ) -> Command:
        kit, n = progress.kit, len(progress.phase)
        command = {name: np.zeros((n, width)) for name, width in kit.platform.commands.items()}
        acting = {"strong": progress.within(*DAMPED), "weak": progress.within(*SWINGING)}
        acting["level"] = progress.within(Phase.level)
        # Only of a body that hangs still: on one that swings, masses would swing along.
        # With the CM where a round has put it the body comes back by itself, unless it lies on the
        # stop or the round was wrong: damped strongly it creeps, and looks as if it hung.
        comes = (progress.rounds > 0) & (kit.lean(estimate) <= NEAR)
        leaning = progress.within(Phase.settle) & (kit.lean(estimate) > CLEAR)
        leaning &= time - progress.swinging_until > np.where(comes, LONGEST, SMOOTHED)
        if leaning.any():
            step = kit.reach.uphill(estimate, kit.platform.tick)
            uphill = np.clip(progress.goal + step, *kit.reach.masses.travel)
            progress.goal = np.where(leaning[:, None], uphill, progress.goal)
        for name, rows in acting.items():
            if not rows.any():
                continue
            follows = self.level_reference.at(time - progress.since) if name == "level" else target
            part, progress.states[name] = kit.laws[name].update(
                progress.states[name], estimate, follows, time
            )
            goal = part.pop("command_stage_position", None)
            if goal is not None:
                progress.goal = np.where(rows[:, None], goal, progress.goal)
                share = kit.platform.tick / (AVERAGED * self.level_for)
                progress.smooth = progress.smooth + share * (progress.goal - progress.smooth)
            put(command, part, rows)
        command["command_stage_position"] = progress.goal.copy()
        return command

    def _enter(self, progress: BalancingProgress, rows: Mask, phase: Phase, time: float) -> None:
        if not rows.any():
            return
        progress.phase = np.where(rows, int(phase), progress.phase)
        progress.since = np.where(rows, time, progress.since)
        progress.log_start = np.where(rows, np.inf, progress.log_start)
        for run in np.flatnonzero(rows):
            self.lab.notes.begin(int(run), phase, time)

    def _record(self, progress: BalancingProgress, rows: Mask, phase: Phase, time: float) -> None:
        self._enter(progress, rows, phase, time)
        progress.log_start = np.where(rows, time, progress.log_start)

    def _level(self, progress: BalancingProgress, rows: Mask, time: float) -> None:
        if self.level is None or not rows.any():
            return
        fresh = self.level.init(progress.kit.platform, len(rows))
        progress.states["level"] = renewed(progress.states["level"], fresh, rows)
        progress.smooth = np.where(rows[:, None], progress.goal, progress.smooth)
        self._enter(progress, rows, Phase.level, time)

    def _nudge(
        self, progress: BalancingProgress, rows: Mask, estimate: Estimate, time: float
    ) -> None:
        """A body whose offset is not known is taken to hang from the CR as it does."""
        if not rows.any():
            return
        unknown = rows & (progress.rounds == 0)
        hanging = -progress.stiffness / progress.kit.platform.gravity
        guess = hanging[:, None] * vertical_body(estimate.attitude)
        guess = guess - progress.kit.reach.moment(estimate.stage_position)
        progress.base = np.where(unknown[:, None], guess, progress.base)
        progress.rest = np.where(rows[:, None], progress.goal, progress.rest)
        aside = progress.kit.nudge(progress.goal, progress.amplitude, progress.stiffness)
        progress.goal = np.where(rows[:, None], aside, progress.goal)
        self._enter(progress, rows, Phase.nudge, time)

    def _ask(self, progress: BalancingProgress, run: int, time: float) -> None:
        """Have a phase's log identified; free float together with the swing before it."""
        log, verifying = (
            self.lab.logbook.recording(run, float(progress.log_start[run])),
            progress.phase[run] == Phase.verify,
        )
        logs = [*self.lab.logs[run], log] if verifying else [log]
        self.lab.logs[run] = logs
        aside = progress.kit.reach.moment(progress.goal[run : run + 1])
        sizes = GUESSES if progress.rounds[run] == 0 else GUESSES[:1]
        self.lab.fits.ask(run, logs, sizes[:, None] * (progress.base[run] + aside) - aside)
        phase = Phase.judge if verifying else Phase.identify
        self._enter(progress, progress.only(run), phase, time)

    def _answered(
        self, progress: BalancingProgress, run: int, estimate: Estimate, time: float
    ) -> None:
        result = self.lab.fits.answer(run)
        if result is None:
            return
        end = conclude(
            self.lab,
            self.aim,
            progress,
            run,
            result,
            estimate.stage_position[run],
            in_plane=self.level is None or self.level_once or progress.rounds[run] == 0,
            time=time,
        )
        if end.goal is not None:
            progress.goal[run] = end.goal
            progress.levelled[run] &= self.level_once
        if end.phase is Phase.verify:
            self._record(progress, progress.only(run), Phase.verify, time)
        elif end.phase is Phase.stopped:
            self._stop(progress, run, end.words, estimate, time)
        elif end.phase is Phase.settle:
            self._again(progress, run, end.words, time)
        else:
            self._enter(progress, progress.only(run), end.phase, time)

    def _again(self, progress: BalancingProgress, run: int, why: str, time: float) -> None:
        progress.tries[run] += 1
        if progress.tries[run] > TRIES:
            self._stop(progress, run, f"{why}, {TRIES} times one after the other", None, time)
            return
        self.lab.notes.say(run, time, f"again: {why}")
        self._enter(progress, progress.only(run), Phase.settle, time)

    def _stop(
        self,
        progress: BalancingProgress,
        run: int,
        why: str,
        estimate: Estimate | None,
        time: float,
    ) -> None:
        if estimate is not None:
            progress.goal[run] = estimate.stage_position[run]
        self.lab.notes.stop(run, time, why)
        self._enter(progress, progress.only(run), Phase.stopped, time)


def _unrest(progress: BalancingProgress, run: int, estimate: Estimate) -> str:
    """Why a run waits in vain."""
    away = np.abs(estimate.stage_position[run] - progress.goal[run])
    if away.max() > ARRIVED:
        stage = progress.kit.platform.stages[int(np.argmax(away))].name
        return f"{stage} is still {away.max() * 1e3:.3g} mm from where it was sent"
    lean = np.degrees(progress.kit.platform.lean(estimate.attitude[run]))
    rate = np.degrees(np.linalg.norm(progress.rate[run]))
    return (
        f"the body does not come to rest within {PATIENCE:g} s: it leans {lean:.3g} deg "
        f"and turns at {rate:.2g} deg/s"
    )
