"""How true the simulation is: `python -m benchmarks.fidelity` writes docs/fidelity.md.

The tests of closed forms and peers state each deviation beside the tolerance that they claim
(the fixture `agrees`). This runs them all, and says which tolerance is looser than it need be.
"""

import json
import subprocess
import sys
import tempfile
from collections import Counter
from importlib.metadata import version
from pathlib import Path
from typing import Any
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
level of rounding, at or below 1e-11.
"""
CHAPTERS = {
    "Machines and their parts": "tests.",
    "Effects": "tests.effects.",
    "Effects, undone after they were applied": "tests.effects.test_series",
}
"""Headings, and the modules whose claims stand there; what fits several stands at the last."""


def main() -> int:
    """Run the tests and write the page; 1 if one fails, or a claim is loose or made twice."""
    files = sorted((REPOSITORY / "tests").glob("*/test_*.py"))
    claiming = [str(file) for file in files if "agrees(" in file.read_text(encoding="utf-8")]
    with tempfile.TemporaryDirectory() as folder:
        results = Path(folder) / "results.xml"
        command = [sys.executable, "-m", "pytest", *claiming, "-m", "slow or not slow", "-q"]
        command += ["-o", "junit_family=xunit1"]  # the other family has no properties
        failed = subprocess.run([*command, f"--junitxml={results}"], cwd=REPOSITORY).returncode
        cases = list(ElementTree.parse(results).iter("testcase"))
    claims = [claim for case in cases for claim in claims_of(case)]
    loose = [entry for entry in claims if is_loose(entry)]
    # a test that is expected to fail counts as skipped there, too
    skipped = [
        case.attrib["name"]
        for case in cases
        for item in case.iter("skipped")
        if item.get("type") != "pytest.xfail"
    ]
    if skipped:
        print(f"{PAGE.relative_to(REPOSITORY)} is left as it is, for these were skipped:")
        print("\n".join([*skipped, "Basilisk comes with the extra `peers`"]))
        return 1
    PAGE.write_text(page(claims), encoding="utf-8")
    print(f"{len(claims)} claims in {PAGE.relative_to(REPOSITORY)}")
    for item in loose:
        print(f"loose: {item['what']}: {item['deviation']:.1e}, claimed {item['tolerance']:.0e}")
    counts = Counter((chapter_of(entry), entry["what"]) for entry in claims)
    twice = [what for (_, what), count in counts.items() if count > 1]
    for what in twice:
        print(f"claimed twice: {what}")
    return int(bool(failed or loose or twice))


def claims_of(case: ElementTree.Element) -> list[dict[str, Any]]:
    """What a test of a JUnit file claims, and in which module it stands."""
    result = [item.attrib["value"] for item in case.iter("property") if item.get("name") == "claim"]
    return [{**json.loads(value), "module": case.attrib["classname"]} for value in result]


def is_loose(claim: dict[str, Any]) -> bool:
    """Whether a tolerance says less than it could."""
    return claim["tolerance"] > max(LOOSE * claim["deviation"], ROUND_OFF)


def page(claims: list[dict[str, Any]]) -> str:
    """The tables, with the versions that they were measured with."""
    lines = [HEAD]
    for heading in CHAPTERS:
        rows = sorted(row(claim) for claim in claims if chapter_of(claim) == heading)
        lines += [f"## {heading}", "", "| what | deviation | tolerance | |"]
        lines += ["| --- | --- | --- | --- |", *rows, ""]
    versions = ", ".join(f"{name} {version(name)}" for name in ("mujoco", "numpy", "scipy"))
    return "\n".join([*lines, f"Measured with {versions}.", ""])


def chapter_of(claim: dict[str, Any]) -> str:
    """The heading that it stands under."""
    return [name for name, start in CHAPTERS.items() if claim["module"].startswith(start)][-1]


def row(claim: dict[str, Any]) -> str:
    """Of a table."""
    numbers = f"{claim['deviation']:.1e} | {claim['tolerance']:.0e}"
    return f"| {claim['what']} | {numbers} | {claim['unit']} |"


if __name__ == "__main__":
    sys.exit(main())
