"""`twin check PATH`: a platform's two files held against each other, as a table."""

import dataclasses
import os
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

if TYPE_CHECKING:
    from twin.check import Finding
    from twin.check.finding import Value


@dataclass(frozen=True)
class Check:
    """Hold platform.toml and its MJCF against each other; exit code 1 when something is wrong.

    Compares names, types, axes and limits, the mass budget, inertia and mass moment about the
    centre of rotation as MuJoCo compiles them, the tilt stop, and the default step's error.
    """

    platform: tyro.conf.Positional[str]
    """A shipped platform (see `twin platforms`) or a folder with a platform.toml."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="OUT.png")] = None
    """Draw the machine into this PNG file, too."""
    json: bool = False
    """Print one JSON document instead of a table."""

    def run(self) -> int:
        """Print the findings; 0 when all is well."""
        if sys.platform == "linux" and "DISPLAY" not in os.environ:
            os.environ.setdefault("MUJOCO_GL", "egl")  # MuJoCo reads it when it is imported
        from twin.check import check_platform
        from twin.check.picture import draw
        from twin.cli.output import print_json
        from twin.errors import PlatformError
        from twin.platform import load_platform

        try:
            platform = load_platform(self.platform)
            findings = check_platform(platform)
            title = f"{platform.name}: {platform.title}"
            if self.picture is not None:
                draw(platform, self.picture)
        except PlatformError as problem:
            findings, title = [_unreadable(problem)], self.platform
        if self.json:
            print_json([dataclasses.asdict(finding) for finding in findings])
        else:
            print(_table(title, findings))
        return 0 if all(finding.ok for finding in findings) else 1


def _unreadable(problem: Exception) -> "Finding":
    from twin.check import Finding

    return Finding("files can be read", False, "yes", "no", "", str(problem))


def _table(title: str, findings: "list[Finding]") -> str:
    width = max(len(finding.check) for finding in findings)
    lines = [title]
    for finding in findings:
        found, unit = _text(finding.found, finding.unit), _unit(finding.unit)
        if finding.ok:
            lines.append(f"  ok     {finding.check:<{width}}  {found} {unit}".rstrip())
            continue
        stated = _text(finding.stated, finding.unit)
        lines.append(
            f"  WRONG  {finding.check:<{width}}  stated {stated}, found {found} {unit}".rstrip()
        )
        lines.append(f"         {finding.sentence}")
    wrong = sum(not finding.ok for finding in findings)
    lines.append(f"{len(findings)} checks, {f'{wrong} WRONG' if wrong else 'all ok'}")
    return "\n".join(lines)


def _text(value: "Value", unit: str) -> str:
    import numpy as np

    if value is None:
        return "nothing"
    if isinstance(value, str):
        return value
    numbers = np.atleast_1d(np.asarray(value))
    shown = np.rad2deg(numbers) if unit.startswith("rad") else numbers
    # what is below 1e-13 beside the largest entry is the rounding of sums
    shown = np.where(np.abs(shown) < 1e-13 * np.max(np.abs(shown)), 0.0, shown)
    return " ".join(f"{number:.6g}" for number in shown)


def _unit(unit: str) -> str:
    return unit.replace("rad", "deg")
