"""Effects as perturbations of a prediction, one for each component.

The strength of an amplitude is its value. The strength of a shape, a frequency or a place, is its
change from the value at which the columns are formed; it has a meaning only where the amplitudes
are not 0. Effects that a platform states are perturbations of known strength. What an effect
changes in the MuJoCo model is in the compiled machine, and a fault of a drive is in the drive's
profile; here are torque laws, pushes with axes of the room, and faults of commands, sensors and
clocks.

A spring that rests where a log begins has a rest angle that is fitted: the log shows its first
attitude only as well as its sensors do.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TypeGuard
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from twin import rotation
from twin.effects import (
    BodyEffect,
    CoupleEffect,
    Effect,
    Order,
    ReadingEffect,
    SeriesEffect,
)
from twin.effects.actuators import GasConsumption
from twin.effects.on_body import TorqueLaw
from twin.platform import Platform
from twin.predict.body import Body
from twin.predict.forces import (
    Perturbation,
    as_measured,
    depends_on_start,
    force_of,
    gas_force,
    inverse,
    middles,
    on_grid,
    plain_forces,
    pushed_along,
)
from twin.predict.inputs import Inputs
from twin.predict.sensors import Output
from twin.predict.states import States
from twin.signals import Samples

Array = NDArray[np.float64]
TURN = 1e-4
"""Of a difference [rad]."""
UNSEEN = 1.0
"""1 sigma of a first attitude that no stream shows [rad]."""
BLIND = ("wheel_imbalance",)
"""What turns with a wheel leaves no column: no log has the angles of wheels."""
SMALL = 1e-2
"""Step of a difference, of a component's scale."""
Change = tuple[tuple[Effect, float], ...]
"""Effects and factors; their sum is the change at strength 1."""
BENT = ("command_stage_position", "command_thruster", "command_joint_torque")
"""Commands whose effects do not act in proportion to their size."""
OF_DRIVES = ("command_stage_position", "command_gimbal_rate")
"""Commands whose faults the drives' profiles have."""
Stated = tuple[tuple[Perturbation, ...], Array]
_stated: WeakKeyDictionary[Body, Stated] = WeakKeyDictionary()
_rests: WeakKeyDictionary[Body, tuple[Perturbation, ...]] = WeakKeyDictionary()


def references_of(effect: Effect, bodies: Sequence[Body]) -> tuple[Perturbation, ...]:
    """How an effect would act whose spring rests elsewhere: of each log, a turn about each axis.

    Returns:
        For each log as many as its base has axes; none for an effect without such a spring.
    """
    if not isinstance(effect, BodyEffect) or not effect.follows_start:
        return ()
    return tuple(
        _turned(effect, body, axis, log)
        for log, body in enumerate(bodies)
        for axis in range(body.start.rate.shape[-1])
    )


def _turned(effect: BodyEffect, of: Body, axis: int, log: int) -> Perturbation:
    recording = of.recording

    def force(body: Body) -> Array:
        grid = body.grid
        if body.recording is not recording:
            return np.zeros((grid.segments, grid.steps, body.machine.model.nv))
        turn = np.zeros(body.start.rate.shape[-1])
        turn[axis] = TURN
        return (force_of(effect, body, turn) - force_of(effect, body, -turn)) / (2.0 * TURN)

    name = f"{effect.label} rest of log {log} about {'xyz'[axis]}"
    return Perturbation(name, "rad", _known(of), force=force)


def _known(body: Body) -> float:
    """1 sigma of the first attitude, before a motion is followed [rad]."""
    seen = [o.noise.max() for o in body.outputs if o.stream in ("attitude", "joint_angle")]
    return float(min(seen, default=UNSEEN))


def perturbations_of(effect: Effect, platform: Platform) -> tuple[Perturbation, ...]:
    """What an effect does to a prediction, component by component.

    They are proportional; what an effect does is not, and of a vector what two components do
    together is more than each by itself. At the values where they were formed they add up to the
    effect as it is, so where it is large they are formed anew at the strengths that were found.

    Args:
        effect: at the values where it is linearised; an amplitude of 0 counts as a small one.
        platform: of the machine that is predicted.

    Returns:
        One a component, in their order; none for an effect that changes no expected value.
    """
    if effect.name in BLIND or not isinstance(effect, BodyEffect | SeriesEffect | ReadingEffect):
        return ()
    units = [known.unit for known in effect.parameters() for _ in range(known.size)]
    absent = not effect.values[amplitudes(effect)].any()
    return tuple(
        _perturbation(f"{effect.label} {name}", unit, change, platform, absent=absent)
        for name, unit, change in zip(effect.names, units, _changes(effect), strict=True)
    )


def slopes_of(effect: Effect, platform: Platform) -> tuple[Perturbation, ...]:
    """The same for a fit that starts at the effect, with how it changes there.

    Where stages were is known from their counters to a digit, whatever play their screws have, so
    in proportion to the play little changes; but it says on which side of the digit they stood. Nor
    is what a late thruster or motor does in proportion to its delay.
    """
    parts, size = perturbations_of(effect, platform), amplitudes(effect)
    bent = of_drive(effect) and effect.stream in BENT
    if not parts or not bent or np.count_nonzero(size) != 1 or not effect.values[size].any():
        return parts
    (index,) = np.flatnonzero(size).tolist()
    value, (low, high) = effect.values[index], effect.bounds()
    ends = np.clip(value * (1.0 + SMALL * np.array([-1.0, 1.0])), low[index], high[index])
    before, after = (effect.with_values(np.where(size, end, effect.values)) for end in ends)

    def force(body: Body) -> Array:
        if not _as_counted(effect, body):
            return _input_force(effect, body) / value
        return (_commanded_force(after, body) - _commanded_force(before, body)) / float(
            ends[1] - ends[0]
        )

    def rest(body: Body) -> Array:
        return _input_force(effect, body) - value * force(body)

    return (*parts[:index], replace(parts[index], force=force, rest=rest), *parts[index + 1 :])


def _as_counted(effect: Effect, body: Body) -> bool:
    """Whether the counters, if there are any, show stages where an effect takes them."""
    return body.inputs.stage_course is None or body.inputs.counted_with(effect)


def _commanded_force(effect: Effect, body: Body) -> Array:
    """What the machine was driven with by stages that went as an effect on the command has them,
    less what the log says."""
    if body.inputs.stage_course is None:
        return _input_force(effect, body)
    return _driven_by(body.inputs.with_stages(effect, counted=False), body)


def strengths_of(effect: Effect) -> Array:
    """(p,) the strengths of its perturbations that make up the effect itself."""
    return np.where(amplitudes(effect), effect.values, 0.0)


def with_strengths(effect: Effect, strengths: Array) -> Effect:
    """The effect that its perturbations make at these strengths, within its bounds."""
    low, high = effect.bounds()
    values = np.where(amplitudes(effect), 0.0, effect.values) + strengths
    return effect.with_values(np.clip(values, low, high))


def amplitudes(effect: Effect) -> NDArray[np.bool_]:
    """(p,) which components are amplitudes."""
    return np.concatenate([np.full(known.size, known.amplitude) for known in effect.parameters()])


def of_drive(effect: Effect) -> TypeGuard[SeriesEffect]:
    """Whether it is between a command and what is done: play and dry friction do at a hundredth of
    their size nothing of what they do at all of it."""
    return isinstance(effect, SeriesEffect) and effect.stream.startswith("command_")


def _changes(effect: Effect) -> list[Change]:
    """Of each component: of an amplitude, beside those before it, so that they add up."""
    values, steps = effect.values, (1.0 if of_drive(effect) else SMALL) * effect.scale()
    low, high = effect.bounds()
    size = amplitudes(effect)
    so_far = np.where(size, 0.0, values)
    changes: list[Change] = []
    for i, step in enumerate(steps):
        if size[i]:
            before = effect.with_values(so_far)
            alone = not so_far[size].any()
            more = so_far.copy()
            more[i] = values[i] or step
            slope = 1.0 / float(more[i])
            after = (effect.with_values(more), slope)
            changes.append((after,) if alone else (after, (before, -slope)))
            so_far[i] = values[i]
            continue
        large = np.where(size & (values == 0.0), steps, values)
        ends = [large.copy(), large.copy()]
        ends[0][i] = max(values[i] - step, low[i])
        ends[1][i] = min(values[i] + step, high[i])
        slope = 1.0 / float(ends[1][i] - ends[0][i])
        before, after = (effect.with_values(end) for end in ends)
        changes.append(((after, slope), (before, -slope)))
    return changes


def _perturbation(
    name: str, unit: str, change: Change, platform: Platform, *, absent: bool
) -> Perturbation:
    first = change[0][0]
    if isinstance(first, BodyEffect | ReadingEffect):
        laws = tuple(
            (factor, law)
            for effect, factor in change
            if isinstance(effect, BodyEffect)
            for law in _laws_of(effect, platform, absent=absent)
        )
        # the path of a model without it is not the one along which it acted: its first column is
        # formed along the measured motion
        along = isinstance(first, BodyEffect) and (
            absent or first.predicted_torque(platform) is None
        )
        force = _summed(change, _body_force) if along else None
        return Perturbation(name, unit, force=force, laws=laws, misread=_misreading(change))
    assert isinstance(first, SeriesEffect)
    stream = first.stream
    if stream == "command_stage_position":

        def strayed(output: Output, _: Array) -> Array:
            assert output.course is not None
            course = output.course
            moved = sum(factor * course.less(effect, output.time) for effect, factor in change)
            return np.asarray(moved)[None]

        force = _summed(change, _drive_force)
        return Perturbation(name, unit, force=force, stream="stage_position", shown=strayed)
    if stream.startswith("command_"):
        return Perturbation(name, unit, force=_summed(change, _input_force))

    def late(output: Output) -> Array:
        return sum(
            (factor * _late(effect, output, platform) for effect, factor in change),
            start=np.zeros(len(output.time)),
        )

    def shown(output: Output, truth: Array) -> Array:
        return sum(
            (factor * _shown(effect, output, truth, platform) for effect, factor in change),
            start=np.zeros((1, *output.slot.shape)),
        )

    force = _summed(change, _leaked_force if _weighs(first, platform) else _input_force)
    if first.order is Order.delay:
        return Perturbation(name, unit, force=force, stream=stream, late=late)
    return Perturbation(name, unit, force=force, stream=stream, shown=shown)


def _weighs(effect: Effect, platform: Platform) -> bool:
    """Whether it lets out gas whose place is known."""
    gas = platform.gas
    return isinstance(effect, GasConsumption) and gas is not None and bool(gas.tanks)


def _leaked_force(effect: Effect, body: Body) -> Array:
    assert isinstance(effect, GasConsumption)
    return gas_force(body, effect.rate * middles(body))


def _laws_of(effect: BodyEffect, platform: Platform, *, absent: bool) -> list[TorqueLaw]:
    """Torques of an effect that answer to the path."""
    laws = effect.torque(platform), None if absent else effect.predicted_torque(platform)
    return [law for law in laws if law is not None]


def _summed(change: Change, force: Callable[[Effect, Body], Array]) -> Callable[[Body], Array]:
    def total(body: Body) -> Array:
        grid = body.grid
        none = np.zeros((grid.segments, grid.steps, body.machine.model.nv))
        return sum((factor * force(effect, body) for effect, factor in change), start=none)

    return total


def _body_force(effect: Effect, body: Body) -> Array:
    assert isinstance(effect, BodyEffect)
    return force_of(effect, body)


def _drive_force(effect: Effect, body: Body) -> Array:
    """What stages drive the machine with under a fault of their drives, less what the log says.

    In proportion to what that is at the size that counters show, where they show one: only there do
    stages go as the fault has them, between a counter's digits too.
    """
    course, seen = body.inputs.stage_course, body.inputs.stage_seen
    if course is None or seen is None or body.inputs.counted_with(effect):
        return _input_force(effect, body)
    sized = course.sized(effect, seen)
    if not body.inputs.counted_with(sized):
        return _input_force(effect, body)
    return _input_force(sized, body) * float(effect.values[0] / sized.values[0])


def _input_force(effect: Effect, body: Body) -> Array:
    """What the machine was driven with, less what the log says."""
    assert isinstance(effect, SeriesEffect)
    recording, stream = body.recording, effect.stream
    # the reading of a state drives nothing
    states = [output.stream for output in body.outputs if output.told is None]
    none = np.zeros((body.grid.segments, body.grid.steps, body.machine.model.nv))
    if stream not in body.inputs.used or stream in states:
        return none
    counted = any(output.course is not None for output in body.outputs)
    if stream == "command_stage_position" and counted:
        return _driven_by(body.inputs.with_stages(effect), body)
    series = recording[stream]
    samples = Samples(series.value[None], series.time[None], np.ones((1, len(series)), dtype=bool))
    act = effect.apply if stream.startswith("command_") else effect.undo
    true = act(samples, body.machine.platform)
    if np.array_equal(true.time, samples.time) and np.array_equal(true.value, samples.value):
        return none
    driven = replace(series, time=true.time[0], value=true.value[0])
    inputs = Inputs(body.machine, replace(recording, streams={**recording.streams, stream: driven}))
    if stream == "command_gimbal_rate":  # a gimbal's angle is a state, which carries the rest
        return _commanded_by(inputs, body)
    return _driven_by(inputs, body)


def _commanded_by(inputs: Inputs, body: Body) -> Array:
    """What other commands push with, beyond those that the log says."""
    logged = body.commanded()
    commanded = inputs.commanded(body.grid.edges, body.motion)
    return commanded.reshape(logged.shape) - logged


def _driven_by(inputs: Inputs, body: Body) -> Array:
    """And with what joints that move otherwise do to the body."""
    more = _commanded_by(inputs, body)
    here, plainly = plain_forces(body)
    there = as_measured(body, inputs)
    if (here.position == there.position).all() and (here.velocity == there.velocity).all():
        return more
    needed = plainly - inverse(body.machine, there)
    return more + on_grid(needed, body)


def _late(effect: Effect, output: Output, platform: Platform) -> Array:
    """(m,) how long before its stamp each sample was true [s]."""
    assert isinstance(effect, SeriesEffect)
    blank = Samples(output.value[None], output.time[None], np.ones((1, len(output.time)), bool))
    return output.time - effect.undo(blank, platform).time[0]


def _shown(effect: Effect, output: Output, truth: Array, platform: Platform) -> Array:
    """(1, m, k) what a sensor shows beyond the truth."""
    assert isinstance(effect, SeriesEffect)
    samples = Samples(truth, output.time[None], np.ones((1, len(output.time)), dtype=bool))
    shown = effect.apply(samples, platform).value
    if output.stream == "attitude":
        return rotation.to_rotation_vector(rotation.multiply(rotation.conjugate(truth), shown))
    return shown - truth


def _misreading(change: Change) -> Callable[[Output, States, float], Array] | None:
    """What sensors show beyond the truth along a path, of effects on readings; None of others."""
    if not isinstance(change[0][0], ReadingEffect):
        return None

    def misread(output: Output, path: States, step: float) -> Array:
        return sum(
            (factor * _misread(effect, output, path, step) for effect, factor in change),
            start=np.zeros((1, *output.slot.shape)),
        )

    return misread


def _misread(effect: Effect, output: Output, path: States, step: float) -> Array:
    """(1, m, k) what a sensor shows beyond the truth along a path."""
    assert isinstance(effect, ReadingEffect)
    if output.stream not in effect.reads:
        return np.zeros((1, *output.slot.shape))
    hinge = path.position.shape[-1] == 1
    position, rate = (
        replace(output, stream=stream, sense=None).predicted(path, step)
        for stream in (("joint_angle", "joint_rate") if hinge else ("attitude", "gyro"))
    )
    return effect.error(output.stream, position, rate)


def stated_of(body: Body) -> Stated:
    """What the platform of a log's machine states, and the strengths (a,) of it."""
    if body not in _stated:
        every = [_parts(effect, body.machine.platform) for effect in body.machine.effects]
        every.append(_taken(body))
        parts = tuple(item for result, _ in every for item in result)
        _stated[body] = parts, np.array([size for _, sizes in every for size in sizes])
    return _stated[body]


def _taken(body: Body) -> tuple[list[Perturbation], list[float]]:
    """The gas that thrusters were told to take out of tanks whose places are stated."""
    gas = body.machine.platform.gas
    if gas is None or not gas.tanks or not body.inputs.gas_taken(middles(body)).any():
        return [], []

    def force(body: Body) -> Array:
        return gas_force(body, body.inputs.gas_taken(middles(body)))

    return [Perturbation("gas of thrusters", "1", force=_once(force))], [1.0]


def rests_of(body: Body) -> tuple[Perturbation, ...]:
    """Where the springs of what is stated rest, if that is where the log began: about each axis."""
    if body not in _rests:
        result = [part for effect in body.machine.effects for part in references_of(effect, [body])]
        _rests[body] = tuple(
            replace(item, force=_once(item.force)) for item in result if item.force
        )
    return _rests[body]


def _parts(effect: Effect, platform: Platform) -> tuple[list[Perturbation], list[float]]:
    if isinstance(effect, BodyEffect) and not depends_on_start(effect):
        law = effect.torque(platform)
        pushes = isinstance(effect, CoupleEffect) or effect.pushes(platform)
        perturbation = Perturbation(
            effect.label,
            "1",
            force=_once(lambda body: pushed_along(effect, body)) if pushes else None,
            laws=() if law is None else ((1.0, law),),
            misread=_misreading(((effect, 1.0),)),
        )
        return [perturbation], [1.0]
    if isinstance(effect, SeriesEffect) and effect.stream in OF_DRIVES:
        return [], []
    parts = perturbations_of(effect, platform)
    once = [
        part if part.force is None else replace(part, force=_once(part.force)) for part in parts
    ]
    return once, strengths_of(effect).tolist() if parts else []


def _once(force: Callable[[Body], Array]) -> Callable[[Body], Array]:
    """Whoever poses the same log again asks again."""
    known: WeakKeyDictionary[Body, Array] = WeakKeyDictionary()

    def remembered(body: Body) -> Array:
        if body not in known:
            known[body] = force(body)
        return known[body]

    return remembered
