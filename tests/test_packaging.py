"""An installed wheel works from another directory and takes no name that could be somebody's."""

import json
import os
import re
import subprocess
import sys
import sysconfig
import tomllib
import zipfile
from pathlib import Path

import pytest

from tests.processes import PATIENCE

REPOSITORY = Path(__file__).parents[1]
UV = Path(sys.executable).with_name("uv")
SHIPPED = {".csv", ".md", ".py", ".toml", ".xml"}


def run(*words: str | Path, cwd: Path) -> str:
    clean = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV")}
    done = subprocess.run(
        words, cwd=cwd, capture_output=True, text=True, env=clean, timeout=PATIENCE
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel built from this checkout."""
    out = tmp_path_factory.mktemp("dist")
    run(UV, "build", "--wheel", "--no-build-isolation", "--out-dir", out, cwd=REPOSITORY)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bin folder of an environment that has the wheel and what it needs, not the checkout."""
    environment = tmp_path_factory.mktemp("environment")
    run(sys.executable, "-m", "venv", "--without-pip", environment, cwd=environment)
    python = environment / "bin" / "python"
    run(UV, "pip", "install", "--offline", "--no-deps", "--python", python, wheel, cwd=environment)
    # A folder named in a .pth file lends its packages, but its own .pth files stay unread: the
    # checkout's editable install is not seen.
    site = next(environment.glob("lib/python*/site-packages"))
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return python.parent


def test_the_version_is_that_of_the_newest_release_in_the_changelog():
    stated = tomllib.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))
    changes = (REPOSITORY / "CHANGELOG.md").read_text(encoding="utf-8")
    releases = re.findall(r"^## (\d+\.\d+\.\d+)$", changes, re.MULTILINE)
    assert stated["project"]["version"] == releases[0]


def test_the_wheel_installs_one_name_only(wheel: Path):
    names = {name.split("/")[0] for name in zipfile.ZipFile(wheel).namelist()}
    assert {name for name in names if not name.endswith(".dist-info")} == {"twin"}


def test_the_wheel_carries_every_file_of_models_and_controllers(wheel: Path):
    files = [
        path for kind in ("models", "controllers") for path in (REPOSITORY / kind).rglob("*.*")
    ]
    shipped = {f"twin/{path.relative_to(REPOSITORY)}" for path in files if path.suffix in SHIPPED}
    assert shipped <= set(zipfile.ZipFile(wheel).namelist())


@pytest.mark.parametrize("kind", ["platforms", "controllers"])
def test_installed_machines_and_laws_are_those_of_the_checkout(
    installed: Path, tmp_path: Path, kind: str
):
    ours = run(sys.executable, "-m", "twin", kind, "--json", cwd=REPOSITORY)
    theirs = run(installed / "twin", kind, "--json", cwd=tmp_path)
    names = [entry["name"] for entry in json.loads(ours)]
    assert names
    assert [entry["name"] for entry in json.loads(theirs)] == names


def test_an_installed_twin_says_where_to_get_the_papers_figures(installed: Path, tmp_path: Path):
    words = [installed / "twin", "reproduce", "003"]
    done = subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 1
    assert re.fullmatch(
        r"twin: .*no folder papers/.*source archive or the repository.*\n", done.stderr
    )


def test_installed_machines_lie_inside_the_package(installed: Path, tmp_path: Path):
    platforms = json.loads(run(installed / "twin", "platforms", "--json", cwd=tmp_path))
    inside = installed.parent / "lib"
    assert all(Path(platform["folder"]).is_relative_to(inside) for platform in platforms)


@pytest.mark.parametrize("name", ["models", "controllers", "tests", "benchmarks", "papers"])
def test_no_generic_module_is_installed(installed: Path, tmp_path: Path, name: str):
    code = f"import importlib.util as u; print(u.find_spec({name!r}))"
    assert run(installed / "python", "-c", code, cwd=tmp_path) == "None\n"


def test_an_installed_law_flies_an_installed_machine(installed: Path, tmp_path: Path):
    words = ("run", "sads", "--controller", "quaternion_pd", "--duration", "1", "--json")
    assert json.loads(run(installed / "twin", *words, cwd=tmp_path))["ended"] == "done"


def test_the_lock_names_only_the_public_registry():
    lock = (REPOSITORY / "uv.lock").read_text(encoding="utf-8")
    addresses = {word.split("/")[2] for word in lock.split('"') if word.startswith("http")}
    assert addresses == {"pypi.org", "files.pythonhosted.org"}
