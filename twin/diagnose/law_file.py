"""A law without a name as an effect of its own: a file that a simulation runs."""

from collections.abc import Sequence
from pathlib import Path

from twin.diagnose.cause import Equation
from twin.platform import Platform

_HEAD = '''"""What logs of {platform} show and no effect explains. Written by `twin diagnose`."""

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
_TORQUE = '''
    def torque(self, platform: Platform):
        """See above."""

        def law(state: State) -> NDArray[np.float64]:
{quantities}
            torque = np.zeros_like(state.rate)
{terms}
            return torque

        return law
'''


def write_law(equation: Equation, platform: Platform, path: Path) -> None:
    """Write a law as an effect whose typical size is the one that was found.

    Args:
        equation: the law.
        platform: whose logs showed it.
        path: of the file, `--effects PATH` runs it.
    """
    hinge = platform.base.kind == "hinge"
    parameters: list[str] = []
    terms: list[str] = []
    needed: set[str] = set()
    for number, (law, value, half) in enumerate(
        zip(equation.laws, equation.coefficients, equation.half_widths, strict=True), start=1
    ):
        product = " * ".join([f"self.size_{number}", *law.factors])
        axis = 0 if hinge else "xyz".index(law.axis)
        terms.append(f"            torque[:, {axis}] += {product}")
        parameters += [
            f"    size_{number}: float = parameter(",
            f'        "{law.label}",',
            f'        "{law.unit}",',
            f"        {value:.9g},",
            f'        source="fitted: {value - half:.3g} to {value + half:.3g}",',
            "    )",
        ]
        needed.update(law.factors)
    up = any(name.startswith("up") for name in needed)
    head = _HEAD.format(
        platform=platform.name,
        imports="from twin.rotation import vertical_body\n" if up else "",
        name=path.stem,
        streams='("joint_angle",)' if hinge else '("gyro", "attitude")',
    )
    body = _TORQUE.format(
        quantities="\n".join(_quantities(sorted(needed), platform)), terms="\n".join(terms)
    )
    path.write_text(head + "\n".join(parameters) + "\n" + body, encoding="utf-8")


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
        found.append(f"            {name} = {value}")
    return found
