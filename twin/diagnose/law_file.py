"""Laws without a name as effects of their own: files that a simulation runs."""

import re
from collections.abc import Sequence
from itertools import count
from pathlib import Path

from twin.diagnose.cause import Equation
from twin.diagnose.law import TORQUE, Law
from twin.platform import Platform

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
    streams = {streams}

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
    )
    pushes = [
        f"            torque[:, {0 if hinge else 'xyz'.index(law.column)}] += "
        + " * ".join([f"self.size_{number}", *map(_variable, law.factors)])
        for number, (law, _, _) in zip(count(1), terms, strict=False)
    ]
    body = _PUSH.format(
        quantities="\n".join(_quantities(sorted(needed), platform)), terms="\n".join(pushes)
    )
    return head + _sizes(terms) + body


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
    found: list[str] = []
    for name in needed:
        kind, _, part = name.partition("_")
        if name == "time":
            value = "state.time"
        elif kind == "speed":
            value = f"state.wheel_speed[:, {wheels.index(part)}]"
        elif kind == "up":
            value = f"vertical_body(state.position)[:, {'xyz'.index(part)}]"
        else:
            source = "position" if kind == "angle" else "rate"
            value = f"state.{source}[:, {'xyz'.index(part) if part else 0}]"
        found.append(f"            {_variable(name)} = {value}")
    return found


def _variable(name: str) -> str:
    """A quantity as Python may call it: a wheel may be `rw-x`."""
    return re.sub(r"\W", "_", name)
