"""The extended platform, and what it gains on a log that took no part in the diagnosis.

It is a folder like the one diagnosed, with base and effects as fitted. Laws without a name become
files of effects that a simulation runs.
"""

import re
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any
from xml.parsers import expat

import mujoco
import numpy as np
import tomlkit
from numpy.typing import NDArray

from twin.comparison.explanation import HORIZONS, FreeRun, free_run
from twin.conventions import ConventionFinding
from twin.diagnosis.baseline import read_rightly
from twin.diagnosis.cause import Equation
from twin.diagnosis.diagnosis import Diagnosis
from twin.diagnosis.explanation import Explanation
from twin.diagnosis.laws import ALL, TORQUE, Law
from twin.effects import Effect, file_of, with_effects
from twin.errors import UsageError
from twin.identification.prediction_error import NORMAL, fit
from twin.identification.start import first_biases
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.base import ENTRIES, BaseParameters
from twin.predict.body import Body, body_of
from twin.predict.columns import perturbations_of, references_of, strengths_of
from twin.predict.forces import Perturbation, predicted_machine
from twin.predict.independent_segments import fit_independent_segments
from twin.predict.innovations import Problem, retraced
from twin.predict.logs import motion_of, usable
from twin.recording import Recording
from twin.recording.pauses import longest_of
from twin.shown import Shown
from twin.stop import at_last

LAW = "law.py"
"""Of a torque."""
LAW_OF = "law_of_{stream}.py"
"""Of a sensor's error."""
_TORQUE = '''"""What logs of {platform} show and no effect explains; by `twin diagnose`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from twin.effects import BodyEffect, Domain, State, parameter
from twin.platform import Platform
{imports}

@dataclass(frozen=True)
class Law(BodyEffect):
    """A torque on the base, body axes: a sum of products of what the logs show (SI)."""

    name = "{name}"
    domain = Domain.torque
    observable = "what it was found by: motion that nothing else explains"
    streams = {streams}{floor}

'''
_PUSH = '''
    def torque(self, platform: Platform):
        """See above."""

        def law(state: State) -> NDArray[np.float64]:
{quantities}
            torque = np.zeros_like(state.rate)
{terms}
            return torque

        return law
'''
_SENSOR = '''"""What logs of {platform} show and no effect explains; by `twin diagnose`."""

from dataclasses import dataclass

from twin.effects import SensorLaw, parameter


@dataclass(frozen=True)
class Law(SensorLaw):
    """What {stream} shows beyond the truth: a sum of products of that (SI)."""

    name = "{name}"
    observable = "what it was found by: readings that nothing else explains"
    streams = ("{stream}",)
    acts_on = "{stream}"
    products = (
{products}
    )

'''
Term = tuple[Law, float, float]
"""A law, its coefficient, and half its 95 % interval."""
Array = NDArray[np.float64]


def write_laws(equation: Equation, platform: Platform, folder: Path) -> tuple[Path, ...]:
    """Write laws as effects whose typical size is the one that was found.

    Args:
        equation: the laws.
        platform: whose logs showed them.
        folder: where they go, `law.py` of a torque, `law_of_STREAM.py` of a sensor's error.

    Returns:
        The files, each of which `--effects PATH` runs.
    """
    terms = list(
        zip(
            equation.laws,
            equation.coefficients.tolist(),
            equation.half_widths.tolist(),
            strict=True,
        )
    )
    written: list[Path] = []
    for what in dict.fromkeys(law.what for law in equation.laws):
        own = [term for term in terms if term[0].what == what]
        path = folder / (LAW if what == TORQUE else LAW_OF.format(stream=what))
        text = _torque(own, platform, path) if what == TORQUE else _sensor(own, platform, path)
        path.write_text(text, encoding="utf-8")
        written.append(path)
    return tuple(written)


def laws_in(folder: Path) -> tuple[Path, ...]:
    """The files that were written to it."""
    return (*sorted(folder.glob(LAW)), *sorted(folder.glob(LAW_OF.format(stream="*"))))


def _torque(terms: Sequence[Term], platform: Platform, path: Path) -> str:
    hinge = platform.base.kind == "hinge"
    needed = {name for law, _, _ in terms for name in law.factors}
    head = _TORQUE.format(
        platform=platform.name,
        imports="from twin.rotation import vertical_body\n" if _leans(needed) else "",
        name=path.stem,
        streams='("joint_angle",)' if hinge else '("gyro", "attitude")',
        floor="\n    on_floor = True" if platform.base.on_floor else "",
    )
    pushes = [
        f"            torque{_place(law, hinge=hinge)} += "
        + " * ".join([f"self.size_{number}", *map(_variable, law.factors)])
        for number, (law, _, _) in zip(count(1), terms, strict=False)
    ]
    body = _PUSH.format(
        quantities="\n".join(_quantities(sorted(needed), platform)), terms="\n".join(pushes)
    )
    return head + _sizes(terms) + body


def _place(law: Law, *, hinge: bool) -> str:
    """Which column of a torque a law adds to; none of them for all."""
    if law.column == ALL:
        return ""
    return f"[:, {0 if hinge else ALL.index(law.column)}]"


def _sensor(terms: Sequence[Term], platform: Platform, path: Path) -> str:
    products = [f"        {(law.column, law.factors)!r},".replace("'", '"') for law, _, _ in terms]
    head = _SENSOR.format(
        platform=platform.name,
        stream=terms[0][0].what,
        name=path.stem,
        products="\n".join(products),
    )
    return head + _sizes(terms)


def _sizes(terms: Sequence[Term]) -> str:
    """A parameter each."""
    lines: list[str] = []
    for number, (law, value, half) in zip(count(1), terms, strict=False):
        lines += [
            f"    size_{number}: float = parameter(",
            f'        "{law.label}",',
            f'        "{law.unit}",',
            f"        {value:.9g},",
            f'        source="fitted: {value - half:.3g} to {value + half:.3g}",',
            "    )",
        ]
    return "\n".join(lines) + "\n"


def _leans(needed: set[str]) -> bool:
    return any(name.startswith("up") for name in needed)


def _quantities(needed: Sequence[str], platform: Platform) -> list[str]:
    """Lines that take them from a state."""
    wheels = [wheel.name for wheel in platform.wheels]
    hinge = platform.base.kind == "hinge"
    result: list[str] = []
    for name in needed:
        kind, _, part = name.partition("_")
        if name == "time":
            value = "state.time"
        elif not part and not hinge:
            value = "state.rate" if kind == "rate" else "vertical_body(state.position)"
        elif kind == "speed":
            value = f"state.wheel_speed[:, {wheels.index(part)}]"
        elif kind == "up":
            value = f"vertical_body(state.position)[:, {'xyz'.index(part)}]"
        else:
            source = "position" if kind == "angle" else "rate"
            value = f"state.{source}[:, {'xyz'.index(part) if part else 0}]"
        result.append(f"            {_variable(name)} = {value}")
    return result


def _variable(name: str) -> str:
    """A quantity as Python may call it: a wheel may be `rw-x`."""
    return re.sub(r"\W", "_", name)


@dataclass(frozen=True)
class Validation(Shown):
    """Base, effects and laws as they were found; only biases and initial states are this log's."""

    log_likelihood: float
    """Gained by causes and laws [nats]."""
    before: float
    """Chi-square of the innovations a sample, with the base that was found without any cause."""
    after: float
    free_runs: Mapping[float, FreeRun | None]
    conventions: tuple[ConventionFinding, ...]
    """What the log was misread by."""
    repairs: tuple[str, ...]
    """Of it, and which part of it was looked at."""


def validate(diagnosis: Diagnosis, recording: Recording) -> Validation:
    """Predict another log of the same machine with what was found; of one with pauses the longest
    part.

    Raises:
        UsageError: the log lacks the streams that the prediction needs.
    """
    used = usable(recording, diagnosis.platform)
    log, conventions = read_rightly(longest_of(used), diagnosis.platform)
    before, after = (
        _held(item, log, diagnosis.platform) for item in (diagnosis.baseline, diagnosis.explained)
    )
    samples = before.bodies[0].samples
    return Validation(
        # by one scatter: where both models lose the motion, each has its own
        0.5 * (before.prediction.cost - after.prediction.cost) / after.account.inflation,
        _chi2(before) / samples,
        _chi2(after) / samples,
        {horizon: free_run(horizon, before.account, after.account) for horizon in HORIZONS},
        conventions,
        log.repairs,
    )


def _chi2(explanation: Explanation) -> float:
    """Of what is left, in units of the noise."""
    left = [values for log in explanation.account.left for values in log]
    return sum(float(np.sum(np.square(values))) for values in left)


def _held(explanation: Explanation, log: Recording, platform: Platform) -> Explanation:
    """An explanation on another log."""
    body = body_of(predicted_machine(platform), log, motion_of(log, platform))
    parts = [perturbations_of(effect, platform) for effect in explanation.effects]
    more = [part for effect in parts for part in effect]
    more += [law.perturbation for law in explanation.laws]
    strengths = [strengths_of(effect) for effect in explanation.effects]
    laws = explanation.at.strengths[explanation.layout.of_laws]
    problem = _posed(explanation, body, more)
    rests = np.zeros(len(problem.perturbations) - len(more))
    start = problem.start(
        explanation.at.theta, [first_biases(body)], np.concatenate([rests, *strengths, laws])
    )
    if explanation.follows:
        first = fit(problem, start)
        # once more along the motion that it gives the log, free of the sensors' noise
        body = retraced(problem, first.innovations, 0)
        problem = _posed(explanation, body, more)
        second = fit(problem, first.at)
        now, converged = second.innovations, second.converged
    else:
        now, converged = fit_independent_segments(problem, start), True
    return Explanation(
        (body,),
        explanation.base,
        explanation.effects,
        tuple(np.ones(len(effect), dtype=bool) for effect in parts),
        explanation.laws,
        problem,
        now,
        converged,
        most=tuple(0.0 for _ in parts),
    )


def _posed(explanation: Explanation, body: Body, more: Sequence[Perturbation]) -> Problem:
    """What was found is held; where this log's springs rest is not."""
    rests = [part for effect in explanation.effects for part in references_of(effect, [body])]
    return Problem([body], explanation.base, [*rests, *more], held=True, strengths_held=True)


def extend(diagnosis: Diagnosis, folder: Path) -> Platform:
    """Write the platform with the base and the causes that a diagnosis found.

    Comments and everything else of platform.toml stay; logs are not copied. A law without a name
    becomes an effect's file beside it (`law_file`): a platform runs no code of its own, so the file
    of an effect that a lab brought is copied there, too. A folder that cannot be finished is taken
    away again.

    Returns:
        The platform, read back from the folder, with the effects whose files lie beside it.

    Raises:
        UsageError: the folder exists and is not empty.
        PlatformError: the fitted base is no rigid body.
    """
    check_new(folder)

    def remove() -> None:
        shutil.rmtree(folder, ignore_errors=True)

    with at_last(remove):
        try:
            return _extended(diagnosis, folder)
        except BaseException:
            remove()
            raise


def _extended(diagnosis: Diagnosis, folder: Path) -> Platform:
    platform, result = diagnosis.platform, diagnosis.explained
    left_out = shutil.ignore_patterns("logs", "*.rrd")
    shutil.copytree(platform.folder, folder, ignore=left_out, dirs_exist_ok=True)
    path = folder / "platform.toml"
    document: Any = tomlkit.parse(path.read_text(encoding="utf-8"))
    _flatten(document, platform)
    entries = _about_origin(result.base.entries(result.at.theta), platform).tolist()
    logs = ", ".join(dict.fromkeys(Path(log.source).name for log in diagnosis.recordings))
    _state_surroundings(document, diagnosis, logs)
    base = document["mass_properties"]
    half = _half_widths(result)
    for key, own in (("inertia", slice(0, 6)), ("center_of_mass_offset", slice(6, 9))):
        base[key] = [_rounded(value) for value in entries[own]]
        ends = ", ".join(f"{value:.2g}" for value in half[own])
        base[key].comment(f"fitted to {logs}; 95 %: +- {ends}")
    if result.base.with_mass:
        base["mass"] = _rounded(float(result.at.theta[0]))
        width = NORMAL * float(np.sqrt(result.covariance[0, 0]))
        base["mass"].comment(f"fitted to {logs}; 95 %: +- {width:.2g}")
    document["title"] = f"{platform.title}, as its logs have it"
    if diagnosis.causes:
        effects = document.setdefault("effects", tomlkit.table())
        for cause in diagnosis.causes:
            if file_of(type(cause.effect)) is None:
                state_effect(effects, cause.effect, cause.half_widths, logs)
    for _, file in own_causes(diagnosis):
        shutil.copy(file, folder / file.name)
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    _introduce(folder / "README.md", diagnosis, logs)
    if diagnosis.equation is not None:
        write_laws(diagnosis.equation, platform, folder)
    extended = load_platform(str(folder))
    give_inertial(extended.model_path, extended.base.body, compile_model(extended).model)
    give_joints(extended.model_path, result.base, result.at.theta)
    return with_effects(extended, [effect for effect, _ in own_causes(diagnosis)])


def own_causes(diagnosis: Diagnosis) -> list[tuple[Effect, Path]]:
    """Causes that are no effects of the catalogue, with the files that a lab brought."""
    effects = [cause.effect for cause in diagnosis.causes]
    return [(effect, file) for effect in effects if (file := file_of(type(effect))) is not None]


def _about_origin(entries: Array, platform: Platform) -> Array:
    """(9,) J and m r about the CR; of a body that falls freely from those about its centre of
    mass."""
    if not platform.base.falls:
        return entries
    variant = platform.name.partition(":")[2]
    stated = load_platform(f"{platform.folder}:{variant}" if variant else platform.folder)
    carried = stated.inertia - platform.inertia
    six = [carried[i, j] for i, j in ENTRIES]
    return np.concatenate([entries[:6] + six, stated.center_of_mass_offset])


def _state_surroundings(document: Any, diagnosis: Diagnosis, logs: str) -> None:
    """Gravity and field as the logs state them: what was fitted goes with those. Logs in several
    fields leave that of the platform."""
    surroundings = [log.provenance.get("environment") or {} for log in diagnosis.recordings]
    for key in ("gravity", "magnetic_field"):
        stated = [surrounding[key] for surrounding in surroundings if key in surrounding]
        if not stated or any(item != stated[0] for item in stated):
            continue
        environment = document.setdefault("environment", tomlkit.table())
        environment[key] = stated[0]
        environment[key].comment(f"as stated by {logs}")


def _introduce(readme: Path, diagnosis: Diagnosis, logs: str) -> None:
    """Say on top of what is known of the machine that this is not quite that machine."""
    before = readme.read_text(encoding="utf-8") if readme.exists() else ""
    causes = [f"- {cause.effect.words()}" for cause in diagnosis.causes]
    what = "these effects" if causes else "no effect"
    name = diagnosis.platform.name
    said = [
        f"# {diagnosis.platform.title}, as its logs have it",
        "",
        f"Written by `twin diagnose --extend` from {logs}: `{name}` with J and m r as fitted, and "
        f"{what} in platform.toml. All that follows is said of `{name}`.",
        "",
        *(causes + [""] if causes else []),
    ]
    readme.write_text("\n".join(said) + "\n" + before, encoding="utf-8")


def _half_widths(explanation: Explanation) -> Array:
    """(9,) of the 95 % intervals of J and m r."""
    to_entries = explanation.base.map
    fitted = to_entries.shape[1]
    spread = to_entries @ explanation.covariance[:fitted, :fitted] @ to_entries.T
    return NORMAL * np.sqrt(np.maximum(np.diag(spread), 0.0))


def check_new(folder: Path) -> None:
    """Whether a folder can be written without overwriting anything.

    Raises:
        UsageError: it cannot.
    """
    whole = folder.absolute()
    above = next(part for part in (whole, *whole.parents) if part.exists())
    if not above.is_dir():
        raise UsageError(f"{above} is a file, where a folder is to be written; name a new folder")
    if folder.exists() and any(folder.iterdir()):
        raise UsageError(f"{folder} exists and is not empty; name a new folder")


def give_inertial(path: Path, body: str, model: mujoco.MjModel) -> None:
    """Give a body that an MJCF itself states the inertial of the one that has it now."""
    index = model.body(body).id
    inertial = "<inertial " + " ".join(
        f'{name}="{" ".join(f"{value:.17g}" for value in np.atleast_1d(values))}"'
        for name, values in (
            ("mass", model.body_mass[index]),
            ("pos", model.body_ipos[index]),
            ("quat", model.body_iquat[index]),
            ("diaginertia", model.body_inertia[index]),
        )
    )
    content = path.read_bytes()
    start = _inertial_of(body, content)
    if start is not None:
        stop = start + re.search(rb"/?>", content[start:]).start()  # pyright: ignore
        path.write_bytes(content[:start] + inertial.encode() + content[stop:])


def _inertial_of(body: str, content: bytes) -> int | None:
    """Where a body's own <inertial> begins; None where it has none in this file."""
    reader = expat.ParserCreate()
    path: list[str] = []
    result: list[int] = []

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if tag == "inertial" and path[-1:] == [body]:
            result.append(reader.CurrentByteIndex)
        path.append(attributes.get("name", "") if tag == "body" else tag)

    reader.StartElementHandler = begin
    reader.EndElementHandler = lambda _: path.pop()
    reader.Parse(content, True)
    return result[0] if result else None


def give_joints(path: Path, base: BaseParameters, theta: Array) -> None:
    """Give the MJCF's joints the damping and stiffness that were fitted.

    Raises:
        UsageError: a joint is not in this file, but in one that it includes.
    """
    if not base.joints:
        return
    spec = mujoco.MjSpec.from_file(str(path))
    text = path.read_text(encoding="utf-8")
    for joint, value in zip(base.joints, theta[-len(base.joints) :].tolist(), strict=True):
        own = spec.joint(joint.joint)
        name = "stiffness" if joint.kind == "stiffness" else "damping"
        numbers = own.stiffness if joint.kind == "stiffness" else own.damping
        numbers[int(joint.kind == "quadratic damping")] += value - joint.stated
        values = " ".join(f"{number:.9g}" for number in np.trim_zeros(numbers, "b"))
        written, known_as = f'{name}="{values}"', re.escape(joint.joint)
        element = re.search(rf'<joint\b[^>]*\bname="{known_as}"[^>]*?(?=\s*/?>)', text)
        if element is None:
            raise UsageError(
                f"{path.name} does not hold joint {joint.joint!r} itself; write {written} to where "
                "it stands"
            )
        bare = re.sub(rf'\s*\b{name}="[^"]*"', "", element[0])
        text = text[: element.start()] + f"{bare} {written}" + text[element.end() :]
    path.write_text(text, encoding="utf-8")


def _flatten(document: Any, platform: Platform) -> None:
    """Make the variant that was diagnosed the platform itself."""
    _, _, variant = platform.name.partition(":")
    changes = document.get("variants", {}).get(variant, {}) if variant else {}
    base = document["mass_properties"]
    for key, value in changes.items():
        if key in base:
            base[key] = value
        elif isinstance(document.get(key), list):
            for row in document[key]:
                row.update(value)
        else:
            document.setdefault(key, tomlkit.table()).update(value)
    document.pop("variants", None)


def state_effect(effects: Any, effect: Effect, half_widths: Array, logs: str) -> None:
    """`[effects.NAME]`, or `[effects.NAME.TARGET]`, each number with where it is from.

    Args:
        effects: the table that it goes into.
        effect: as fitted.
        half_widths: (p,) of the 95 % intervals; NaN where a component was not fitted by itself.
        logs: what it was fitted to.
    """
    # a fit may end at a bound, and a rounding beyond it
    rounded = [_rounded(value) for value in effect.values.tolist()]
    effect = effect.with_values(np.clip(rounded, *effect.bounds()))
    table = tomlkit.table()
    for known in effect.parameters():
        table[known.name] = _as_toml(getattr(effect, known.name))
        half, half_widths = half_widths[: known.size], half_widths[known.size :]
        ends = ", ".join("not told" if np.isnan(item) else f"{item:.2g}" for item in half)
        unit = "" if known.unit == "1" else f"{known.unit}; "
        table[known.name].comment(f"{unit}fitted to {logs}; 95 %: +- {ends}")
    for setting in effect.settings():
        if getattr(effect, setting.name) is not None:
            table[setting.name] = _as_toml(getattr(effect, setting.name))
    if effect.target:
        effects.setdefault(effect.name, tomlkit.table())[effect.target] = table
    else:
        effects[effect.name] = table


def _as_toml(value: Any) -> Any:
    if isinstance(value, tuple | np.ndarray):
        return [_as_toml(item) for item in value]
    return float(value) if isinstance(value, float) else value


def _rounded(value: float) -> float:
    """Nine digits: beyond, a fit says nothing."""
    return float(np.format_float_positional(value, 9, unique=False, fractional=False))
