"""The extended platform: a folder like the one diagnosed, with base and effects as found."""

import re
import shutil
from pathlib import Path
from typing import Any
from xml.parsers import expat

import mujoco
import numpy as np
import tomlkit
from numpy.typing import NDArray

from twin.diagnose.diagnosis import Diagnosis
from twin.diagnose.explanation import Explanation
from twin.diagnose.law_file import write_laws
from twin.effects import Effect
from twin.errors import UsageError
from twin.identify.prediction_error import NORMAL
from twin.model import compile_model
from twin.platform import Platform, load_platform
from twin.predict.parameters.base import BaseParameters
from twin.stop import at_last

Array = NDArray[np.float64]


def extend(diagnosis: Diagnosis, folder: Path) -> Platform:
    """Write the platform with the base and the causes that a diagnosis found.

    Comments and everything else of platform.toml stay; logs are not copied. A law without a name
    becomes an effect's file beside it (`law_file`): a platform runs no code of its own. A folder
    that cannot be finished is taken away again.

    Returns:
        The platform, read back from the folder.

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
    platform, found = diagnosis.platform, diagnosis.explained
    left_out = shutil.ignore_patterns("logs", "*.rrd")
    shutil.copytree(platform.folder, folder, ignore=left_out, dirs_exist_ok=True)
    path = folder / "platform.toml"
    document: Any = tomlkit.parse(path.read_text(encoding="utf-8"))
    _flatten(document, platform)
    entries = found.base.entries(found.at.theta).tolist()
    logs = ", ".join(dict.fromkeys(Path(log.source).name for log in diagnosis.recordings))
    _state_surroundings(document, diagnosis, logs)
    base = document["mass_properties"]
    half = _half_widths(found)
    for key, own in (("inertia", slice(0, 6)), ("center_of_mass_offset", slice(6, 9))):
        base[key] = [_rounded(value) for value in entries[own]]
        ends = ", ".join(f"{value:.2g}" for value in half[own])
        base[key].comment(f"fitted to {logs}; 95 %: +- {ends}")
    document["title"] = f"{platform.title}, as its logs have it"
    if diagnosis.causes:
        effects = document.setdefault("effects", tomlkit.table())
        for cause in diagnosis.causes:
            state_effect(effects, cause.effect, cause.half_widths, logs)
    path.write_text(tomlkit.dumps(document), encoding="utf-8")
    _introduce(folder / "README.md", diagnosis, logs)
    if diagnosis.equation is not None:
        write_laws(diagnosis.equation, platform, folder)
    extended = load_platform(str(folder))
    give_inertial(extended.model_path, extended.base.body, compile_model(extended).model)
    give_joints(extended.model_path, found.base, found.at.theta)
    return extended


def _state_surroundings(document: Any, diagnosis: Diagnosis, logs: str) -> None:
    """Gravity and field as the logs state them: what was fitted goes with those. Logs in several
    fields leave that of the platform."""
    surroundings = [log.provenance.get("environment") or {} for log in diagnosis.recordings]
    for key in ("gravity", "magnetic_field"):
        stated = [one[key] for one in surroundings if key in one]
        if not stated or any(one != stated[0] for one in stated):
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


def _half_widths(found: Explanation) -> Array:
    """(9,) of the 95 % intervals of J and m r."""
    to_entries = found.base.map
    fitted = to_entries.shape[1]
    spread = to_entries @ found.covariance[:fitted, :fitted] @ to_entries.T
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
    found: list[int] = []

    def begin(tag: str, attributes: dict[str, str]) -> None:
        if tag == "inertial" and path[-1:] == [body]:
            found.append(reader.CurrentByteIndex)
        path.append(attributes.get("name", "") if tag == "body" else tag)

    reader.StartElementHandler = begin
    reader.EndElementHandler = lambda _: path.pop()
    reader.Parse(content, True)
    return found[0] if found else None


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
        table[known.name] = _plain(getattr(effect, known.name))
        half, half_widths = half_widths[: known.size], half_widths[known.size :]
        ends = ", ".join("not told" if np.isnan(one) else f"{one:.2g}" for one in half)
        unit = "" if known.unit == "1" else f"{known.unit}; "
        table[known.name].comment(f"{unit}fitted to {logs}; 95 %: +- {ends}")
    for setting in effect.settings():
        if getattr(effect, setting.name) is not None:
            table[setting.name] = _plain(getattr(effect, setting.name))
    if effect.target:
        effects.setdefault(effect.name, tomlkit.table())[effect.target] = table
    else:
        effects[effect.name] = table


def _plain(value: Any) -> Any:
    if isinstance(value, tuple | np.ndarray):
        return [_plain(one) for one in value]
    return float(value) if isinstance(value, float) else value


def _rounded(value: float) -> float:
    """Nine digits: beyond, a fit says nothing."""
    return float(np.format_float_positional(value, 9, unique=False, fractional=False))
