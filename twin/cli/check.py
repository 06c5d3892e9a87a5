"""`twin check PATH`: checks of a platform's two files, or of a control law, as a table."""

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
    """Check a platform or a control law; exit code 1 when something is wrong.

    A platform: platform.toml and its MJCF against each other, in names, types, axes and limits, the
    mass budget, inertia and mass moment about the centre of rotation as MuJoCo compiles them, the
    tilt stop, the default step's error, and its [hardware]. A control law: the contract of a
    `Controller`, on the machine that takes its commands.
    """

    path: Annotated[str, tyro.conf.Positional, tyro.conf.arg(metavar="PLATFORM|LAW")]
    """A shipped platform or law by name, a folder with a platform.toml, or a law's .py file."""
    platform: Annotated[str | None, tyro.conf.arg(metavar="NAME|FOLDER")] = None
    """Of a control law: the machine that it is judged on, by default the first shipped one that it
    does not refuse, `sads` before the others."""
    picture: Annotated[Path | None, tyro.conf.arg(metavar="OUT.png")] = None
    """Draw the platform into this PNG file, too; an existing file is overwritten."""
    json: bool = False
    """Print one JSON document instead of a table."""

    def run(self) -> int:
        """Print the findings; 0 when all is well."""
        from twin.cli.output import print_json
        from twin.errors import UsageError
        from twin.files import check_writable
        from twin.library import controller_names

        law = self.path.endswith(".py") or self.path in controller_names()
        if law and self.picture is not None:
            raise UsageError("--picture draws platforms, not control laws")
        if not law and self.platform is not None:
            raise UsageError(
                f"--platform says on which machine a control law is judged, and {self.path} is "
                "none: leave it out, or give the law's .py file"
            )
        if self.picture is not None:
            check_writable(self.picture, ".png")
        title, findings = (
            _law(self.path, self.platform) if law else _platform(self.path, self.picture)
        )
        if self.json:
            print_json([dataclasses.asdict(finding) for finding in findings])
        else:
            print(_table(title, findings))
        return 0 if all(finding.ok for finding in findings) else 1


def _platform(name: str, picture: Path | None) -> "tuple[str, list[Finding]]":
    if picture is not None and os.environ.get("MUJOCO_GL", "disable") == "disable":
        # drawing needs what `twin.cli.main` keeps MuJoCo from loading
        headless = sys.platform == "linux" and "DISPLAY" not in os.environ
        os.environ["MUJOCO_GL"] = "egl" if headless else ""
    from twin.check import Finding, check_platform
    from twin.check.platform import draw
    from twin.errors import PlatformError
    from twin.platform import load_platform

    try:
        platform = load_platform(name)
        findings = check_platform(platform)
        if picture is not None:
            draw(platform, picture)
    except PlatformError as problem:
        return name, [Finding("can be read", False, "yes", "no", "", str(problem))]
    return f"{platform.name}: {platform.title}", findings


def _law(name: str, machine: str | None) -> "tuple[str, list[Finding]]":
    from twin.check import Finding
    from twin.controller import check_controller, load_controller, usual_machine
    from twin.errors import ControllerError
    from twin.platform import load_platform

    # before the law: a machine that is not there is wrong use, whatever the law is
    platform = None if machine is None else load_platform(machine)
    try:
        law = load_controller(name)
    except ControllerError as problem:
        return name, [Finding("can be loaded", False, "yes", "no", "", str(problem))]
    platform = platform or usual_machine(law)
    broken = check_controller(law, platform)
    check = f"keeps the contract on {platform.name}"
    kept = [Finding(check, True, "yes", "yes")]
    return name, [Finding(check, False, "yes", "no", "", said) for said in broken] or kept


def _table(title: str, findings: "list[Finding]") -> str:
    width = max(len(finding.check) for finding in findings)
    lines = [title]
    for finding in findings:
        result, unit = _text(finding.found, finding.unit), _unit(finding.unit)
        if finding.ok:
            lines.append(f"  ok     {finding.check:<{width}}  {result} {unit}".rstrip())
            continue
        stated = _text(finding.stated, finding.unit)
        lines.append(
            f"  WRONG  {finding.check:<{width}}  stated {stated}, found {result} {unit}".rstrip()
        )
        lines.append(f"         {finding.sentence}")
    wrong = sum(not finding.ok for finding in findings)
    plural = "s" if len(findings) > 1 else ""
    lines.append(f"{len(findings)} check{plural}, {f'{wrong} WRONG' if wrong else 'all ok'}")
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
