"""Balancing as a control law with phases: it goes through the one loop, a run or a thousand."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from twin.controller import AnyController, Controller
from twin.platform import Platform
from twin.procedures.kit import ARRIVED, CLEAR, NEAR, Kit
from twin.procedures.lab import Lab
from twin.procedures.means import Reach, damper
from twin.procedures.phases import Phase, among
from twin.procedures.plan import Aim
from twin.procedures.rounds import SHORTEST, TRIES, conclude
from twin.procedures.state import Mask, Progress, put, renewed
from twin.reference import Hold, Reference
from twin.rotation import vertical_body
from twin.signals import Command, Estimate, Target

Array = NDArray[np.float64]

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
THERE = 1.0
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
class Balancing(Controller[Progress]):
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
    """The law of the level phase; None: there is none."""
    level_reference: Reference = field(default_factory=Hold)
    """What it follows, from the start of its phase."""
    level_for: float = 240.0
    """How long it is given [s]."""
    level_once: bool = False
    """Whether it has its turn once, and the rounds go on without it; else it alone moves the CM in
    the plane."""

    def init(self, platform: Platform, n: int) -> Progress:
        """Nothing known; the stiffness taken is that of masses at their lower end.

        Raises:
            ControllerError: the machine has no stages for it, or nothing that damps.
        """
        laws = {"strong": damper(platform, STRONG), "weak": damper(platform, WEAK)}
        if self.level is not None:
            laws["level"] = self.level
        reach = Reach.of(platform)
        states = {name: law.init(platform, n) for name, law in laws.items()}
        now = Progress.start(Kit(platform, reach, laws), n, states)
        now.amplitude[:] = min(SWING, 0.125 * platform.stop_angle)
        now.watch[:] = SHORTEST
        now.stiffness[:] = platform.gravity * reach.depth
        return now

    def finished(self, state: Progress) -> Mask:
        """(n,) the runs that are balanced or stopped."""
        return state.finished

    def update(
        self, state: Progress, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, Progress]:
        """The phases' commands, and the phases after this tick."""
        now = state.copied()
        self._begin(now, estimate, time)
        self._watch(now, estimate, time)
        self._advance(now, estimate, time)
        command = self._command(now, estimate, target, time)
        self.lab.logbook.forget(float(np.min(now.log_start, initial=np.inf)))
        return command, now

    def _begin(self, now: Progress, estimate: Estimate, time: float) -> None:
        """Runs that are seen for the first time: their vertical mass goes to its lower end."""
        fresh = estimate.valid & ~now.seen
        if not fresh.any():
            return
        lowest = now.kit.reach.lowest(estimate.stage_position)
        now.goal = np.where(fresh[:, None], lowest, now.goal)
        now.seen = now.seen | fresh
        self._enter(now, fresh, Phase.lower, time)

    def _watch(self, now: Progress, estimate: Estimate, time: float) -> None:
        """What the conditions of the phases look at."""
        kit = now.kit
        averaged = np.maximum(SMOOTHED, SLOWLY / kit.frequency(now.stiffness))
        share = np.minimum(kit.platform.tick / averaged, 1.0)[:, None]
        now.rate = now.rate + share * (estimate.rate_body - now.rate)
        across = kit.across(now.rate, estimate)
        moving = (across > kit.still(now.amplitude, now.stiffness)) | (kit.lean(estimate) > CLEAR)
        away = kit.away(now.goal, estimate)
        now.swinging_until = np.where(across > SETTLED, time, now.swinging_until)
        now.moving_until = np.where(moving, time, np.maximum(now.moving_until, now.since))
        now.away_until = np.where(away, time, np.maximum(now.away_until, now.since))

    def _advance(self, now: Progress, estimate: Estimate, time: float) -> None:
        """From phase to phase; every run at most once a tick."""
        kit, was, lasted = now.kit, now.phase.copy(), time - now.since
        there = now.seen & (time - now.away_until > THERE)
        still = time - now.moving_until > REST
        touching = kit.lean(estimate) > NEAR

        self._enter(now, (was == Phase.lower) & there, Phase.settle, time)
        rested = (was == Phase.settle) & still & there
        levelling = rested & (now.rounds > 0) & ~now.levelled & (self.level is not None)
        self._level(now, levelling, time)
        self._nudge(now, rested & ~levelling, estimate, time)
        over = (was == Phase.level) & (lasted > self.level_for)
        if not self.level_once:
            now.goal = np.where(over[:, None], now.smooth, now.goal)
        now.levelled = now.levelled | over
        self._enter(now, over, Phase.settle, time)
        aside = (was == Phase.nudge) & there & (lasted > THERE + kit.aside_for(now.stiffness))
        now.goal = np.where(aside[:, None], now.rest, now.goal)
        self._enter(now, aside, Phase.back, time)
        self._record(now, (was == Phase.back) & there, Phase.swing, time)

        recorded = (was == Phase.swing) | (was == Phase.verify)
        for run in np.flatnonzero(recorded & touching):
            now.amplitude[run] *= 0.5
            self._again(now, int(run), "it swings so far that the stop may touch", time)
        long_enough = np.where(was == Phase.verify, FLOAT, now.watch)
        for run in np.flatnonzero(recorded & ~touching & (lasted >= long_enough)):
            self._ask(now, int(run), time)
        asked = (was == Phase.identify) | (was == Phase.judge)
        for run in np.flatnonzero(asked & (lasted >= THINKING)):
            self._answered(now, int(run), estimate, time)
        self._enter(now, (was == Phase.move) & there, Phase.settle, time)
        late = among(was, WAITING) & (now.phase == was) & (lasted > PATIENCE)
        for run in np.flatnonzero(late):
            self._stop(now, int(run), _unrest(now, int(run), estimate), estimate, time)

    def _command(self, now: Progress, estimate: Estimate, target: Target, time: float) -> Command:
        kit, n = now.kit, len(now.phase)
        command = {name: np.zeros((n, width)) for name, width in kit.platform.commands.items()}
        acting = {"strong": now.within(*DAMPED), "weak": now.within(*SWINGING)}
        acting["level"] = now.within(Phase.level)
        # Only of a body that hangs still: on one that swings, masses would swing along.
        leaning = now.within(Phase.settle) & (kit.lean(estimate) > CLEAR)
        leaning &= time - now.swinging_until > SMOOTHED
        if leaning.any():
            step = kit.reach.uphill(estimate, kit.platform.tick)
            uphill = np.clip(now.goal + step, *kit.reach.masses.travel)
            now.goal = np.where(leaning[:, None], uphill, now.goal)
        for name, rows in acting.items():
            if not rows.any():
                continue
            follows = self.level_reference.at(time - now.since) if name == "level" else target
            part, now.states[name] = kit.laws[name].update(
                now.states[name], estimate, follows, time
            )
            goal = part.pop("command_stage_position", None)
            if goal is not None:
                now.goal = np.where(rows[:, None], goal, now.goal)
                share = kit.platform.tick / (AVERAGED * self.level_for)
                now.smooth = now.smooth + share * (now.goal - now.smooth)
            put(command, part, rows)
        command["command_stage_position"] = now.goal.copy()
        return command

    def _enter(self, now: Progress, rows: Mask, phase: Phase, time: float) -> None:
        if not rows.any():
            return
        now.phase = np.where(rows, int(phase), now.phase)
        now.since = np.where(rows, time, now.since)
        now.log_start = np.where(rows, np.inf, now.log_start)
        for run in np.flatnonzero(rows):
            self.lab.notes.begin(int(run), phase, time)

    def _record(self, now: Progress, rows: Mask, phase: Phase, time: float) -> None:
        self._enter(now, rows, phase, time)
        now.log_start = np.where(rows, time, now.log_start)

    def _level(self, now: Progress, rows: Mask, time: float) -> None:
        if self.level is None or not rows.any():
            return
        fresh = self.level.init(now.kit.platform, len(rows))
        now.states["level"] = renewed(now.states["level"], fresh, rows)
        now.smooth = np.where(rows[:, None], now.goal, now.smooth)
        self._enter(now, rows, Phase.level, time)

    def _nudge(self, now: Progress, rows: Mask, estimate: Estimate, time: float) -> None:
        """A body whose offset is not known is taken to hang from the CR as it does."""
        if not rows.any():
            return
        unknown = rows & (now.rounds == 0)
        hanging = -now.stiffness / now.kit.platform.gravity
        guess = hanging[:, None] * vertical_body(estimate.attitude)
        guess = guess - now.kit.reach.moment(estimate.stage_position)
        now.base = np.where(unknown[:, None], guess, now.base)
        now.rest = np.where(rows[:, None], now.goal, now.rest)
        aside = now.kit.nudge(now.goal, now.amplitude, now.stiffness)
        now.goal = np.where(rows[:, None], aside, now.goal)
        self._enter(now, rows, Phase.nudge, time)

    def _ask(self, now: Progress, run: int, time: float) -> None:
        """Have a phase's log identified; free float together with the swing before it."""
        log, verifying = (
            self.lab.logbook.recording(run, float(now.log_start[run])),
            now.phase[run] == Phase.verify,
        )
        logs = [*self.lab.logs[run], log] if verifying else [log]
        self.lab.logs[run] = logs
        aside = now.kit.reach.moment(now.goal[run : run + 1])
        sizes = GUESSES if now.rounds[run] == 0 else GUESSES[:1]
        self.lab.fits.ask(run, logs, sizes[:, None] * (now.base[run] + aside) - aside)
        phase = Phase.judge if verifying else Phase.identify
        self._enter(now, now.only(run), phase, time)

    def _answered(self, now: Progress, run: int, estimate: Estimate, time: float) -> None:
        found = self.lab.fits.answer(run)
        if found is None:
            return
        end = conclude(
            self.lab,
            self.aim,
            now,
            run,
            found,
            estimate.stage_position[run],
            in_plane=self.level is None or self.level_once or now.rounds[run] == 0,
            time=time,
        )
        if end.goal is not None:
            now.goal[run] = end.goal
            now.levelled[run] &= self.level_once
        if end.phase is Phase.verify:
            self._record(now, now.only(run), Phase.verify, time)
        elif end.phase is Phase.stopped:
            self._stop(now, run, end.words, estimate, time)
        elif end.phase is Phase.settle:
            self._again(now, run, end.words, time)
        else:
            self._enter(now, now.only(run), end.phase, time)

    def _again(self, now: Progress, run: int, why: str, time: float) -> None:
        now.tries[run] += 1
        if now.tries[run] > TRIES:
            self._stop(now, run, f"{why}, {TRIES} times one after the other", None, time)
            return
        self.lab.notes.say(run, time, f"again: {why}")
        self._enter(now, now.only(run), Phase.settle, time)

    def _stop(
        self, now: Progress, run: int, why: str, estimate: Estimate | None, time: float
    ) -> None:
        if estimate is not None:
            now.goal[run] = estimate.stage_position[run]
        self.lab.notes.stop(run, time, why)
        self._enter(now, now.only(run), Phase.stopped, time)


def _unrest(now: Progress, run: int, estimate: Estimate) -> str:
    """Why a run waits in vain."""
    away = np.abs(estimate.stage_position[run] - now.goal[run])
    if away.max() > ARRIVED:
        stage = now.kit.platform.stages[int(np.argmax(away))].name
        return f"{stage} is still {away.max() * 1e3:.3g} mm from where it was sent"
    lean = np.degrees(now.kit.platform.lean(estimate.attitude[run]))
    rate = np.degrees(np.linalg.norm(now.rate[run]))
    return (
        f"the body does not come to rest within {PATIENCE:g} s: it leans {lean:.3g} deg "
        f"and turns at {rate:.2g} deg/s"
    )
