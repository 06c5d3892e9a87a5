"""How true the simulation is: `python -m benchmarks.fidelity` writes docs/fidelity.md.

The tests of closed forms and peers state each deviation beside the tolerance that they claim
(the fixture `agrees`). This runs them all, and says which tolerance is looser than it need be.
"""

import json
import subprocess
import sys
import tempfile
from importlib.metadata import version
from pathlib import Path
from xml.etree import ElementTree

REPOSITORY = Path(__file__).parents[1]
PAGE = REPOSITORY / "docs" / "fidelity.md"
LOOSE = 10.0
"""A tolerance is at most so many times what is measured."""
ROUND_OFF = 1e-11
"""A tolerance below this is as good as none: what is measured there is chance."""

HEAD = """# Fidelity

Written by `python -m benchmarks.fidelity`, which runs the tests that claim these tolerances.
Each row is a closed form, or the same physics computed by other code; the deviation is the largest
that the test has seen, and no tolerance is looser than ten times that, but for those at the
level of rounding, below 1e-11.
"""


def main() -> int:
    """Run the tests and write the page; 1 if one fails or a tolerance is loose."""
    files = sorted((REPOSITORY / "tests").glob("*/test_*.py"))
    claiming = [str(file) for file in files if "agrees(" in file.read_text(encoding="utf-8")]
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results.xml"
        command = [sys.executable, "-m", "pytest", *claiming, "-m", "slow or not slow", "-q"]
        command += ["-o", "junit_family=xunit1"]  # the other family has no properties
        failed = subprocess.run([*command, f"--junitxml={results}"], cwd=REPOSITORY).returncode
        claims = claims_of(results)
    loose = [one for one in claims if is_loose(one)]
    PAGE.write_text(page(claims), encoding="utf-8")
    print(f"{len(claims)} claims in {PAGE.relative_to(REPOSITORY)}")
    for one in loose:
        print(f"loose: {one['what']}: {one['deviation']:.1e}, claimed {one['tolerance']:.0e}")
    return int(bool(failed or loose))


def claims_of(results: Path) -> list[dict]:
    """What the tests of a JUnit file claim."""
    found = ElementTree.parse(results).iter("property")
    return [json.loads(one.attrib["value"]) for one in found if one.attrib["name"] == "claim"]


def is_loose(claim: dict) -> bool:
    """Whether a tolerance says less than it could."""
    return claim["tolerance"] > max(LOOSE * claim["deviation"], ROUND_OFF)


def page(claims: list[dict]) -> str:
    """The table, with the versions that it was measured with."""
    lines = [HEAD, "| what | deviation | tolerance | |", "| --- | --- | --- | --- |"]
    for one in sorted(claims, key=lambda one: one["what"]):
        numbers = f"{one['deviation']:.1e} | {one['tolerance']:.0e}"
        lines.append(f"| {one['what']} | {numbers} | {one['unit']} |")
    versions = ", ".join(f"{name} {version(name)}" for name in ("mujoco", "numpy", "scipy"))
    return "\n".join([*lines, "", f"Measured with {versions}.", ""])


if __name__ == "__main__":
    sys.exit(main())
