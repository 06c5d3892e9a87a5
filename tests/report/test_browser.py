"""Pages fit a desktop and a phone in a real browser, in light and in dark, and run no script."""

import re
import shutil
import subprocess
from html import escape
from pathlib import Path

import pytest

import twin

BROWSER = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chrome")
DARK, LIGHT = 0, 1
"""Blink's `preferredColorScheme`."""
FRAME = """<!doctype html><title></title>
<iframe srcdoc="{page}" style="width: {width}px; height: 900px; border: 0" onload="
  const page = this.contentDocument;
  document.title = [this.contentWindow.innerWidth, page.documentElement.scrollWidth,
    getComputedStyle(page.body).backgroundColor].join('|')"></iframe>
"""
"""A window is never narrower than 500 px, a frame in it is."""

SPEC = """
platform = "sads"
controller = "quaternion_pd"
runs = 24
duration = 2.0
seed = 1
[gains]
derivative = { grid = [6.0, 12.0] }
[effects.gyro_bias]
[[arms]]
name = "as shipped"
[[arms]]
name = "stiffer"
[arms.gains]
proportional = 20.0
"""

pytestmark = pytest.mark.skipif(BROWSER is None, reason="no Chromium is installed")


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("pages")
    log = "models/dfki_pendulum/logs/energy_shaping"
    spec = folder / "spec.toml"
    spec.write_text(SPEC, encoding="utf-8")
    run = twin.fly("sads", "quaternion_pd", duration=10.0, effects="gyro_bias=0.001/0/0", seed=1)
    results = {
        "show": twin.show(run.recording),
        "compare": twin.compare(log),
        "diagnose": twin.diagnose(run.recording, "sads"),
        "run": run,
        "identify": twin.identify(log),
        "balance": twin.balance("sads", duration=5.0),
        "campaign": twin.campaign(spec, folder / "campaign"),
    }
    return {name: result.save(folder / f"{name}.html") for name, result in results.items()}


def rendered(page: Path, width: int, scheme: int, folder: Path) -> tuple[int, int, str]:
    """Width of the frame and of the page [px], and the colour behind its text."""
    frame = folder / "frame.html"
    text = escape(page.read_text(encoding="utf-8"))
    frame.write_text(FRAME.format(page=text, width=width), encoding="utf-8")
    done = subprocess.run(
        [
            str(BROWSER),
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            f"--user-data-dir={folder / 'profile'}",
            "--window-size=1500,1000",
            f"--blink-settings=preferredColorScheme={scheme}",
            "--dump-dom",
            frame.as_uri(),
        ],
        capture_output=True,
        text=True,
        timeout=60.0,
        check=True,
    )
    (title,) = re.findall(r"<title>(\d+\|\d+\|.*?)</title>", done.stdout)
    window, wide, colour = title.split("|")
    return int(window), int(wide), colour


@pytest.mark.slow(40)
@pytest.mark.parametrize(
    "name", ["show", "compare", "diagnose", "run", "identify", "balance", "campaign"]
)
def test_a_page_fits_a_desktop_and_a_phone_in_light_and_in_dark(
    pages: dict[str, Path], name: str, tmp_path: Path
):
    assert "<script" not in pages[name].read_text(encoding="utf-8")
    behind = set[str]()
    for width in (1440, 390):
        for scheme in (LIGHT, DARK):
            window, wide, colour = rendered(pages[name], width, scheme, tmp_path)
            assert window == width
            assert wide <= window, f"{name} overflows {width} px by {wide - window} px"
            behind.add(colour)
    assert len(behind) == 2, "dark is dark"
