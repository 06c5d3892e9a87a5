"""The documentation site holds every page of docs/, and is built without a warning."""

import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[1]
CONFIGURATION = REPOSITORY / ".ci" / "mkdocs.yml"


def test_every_page_of_docs_is_in_the_sites_navigation():
    nav = CONFIGURATION.read_text(encoding="utf-8").split("\nnav:\n")[1].split("\nmarkdown_")[0]
    listed = re.findall(r"([\w]+\.md)$", nav, re.MULTILINE)
    assert sorted(listed) == sorted(page.name for page in (REPOSITORY / "docs").glob("*.md"))


@pytest.mark.skipif(find_spec("mkdocs") is None, reason="`make docs` installs mkdocs")
def test_the_site_is_built_without_a_warning(tmp_path: Path):
    words = ["build", "--quiet", "--config-file", str(CONFIGURATION), "--site-dir", str(tmp_path)]
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", *words],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        timeout=100.0,
    )
    assert done.returncode == 0, done.stderr
    assert "bearing_viscous_friction" in (tmp_path / "effects" / "index.html").read_text()
    first_hour = (tmp_path / "first_hour" / "index.html").read_text()
    assert "--8" not in first_hour, "the script itself stands there, not the mark that fetches it"
