"""The effect that CONTRIBUTING.md writes is flown, diagnosed and extended by, as it says."""

import re
import secrets
from pathlib import Path

import numpy as np
import pytest

import twin
from twin.cli.main import main

PAGE = (Path(__file__).parents[1] / "CONTRIBUTING.md").read_text(encoding="utf-8")


@pytest.fixture
def effect(tmp_path: Path) -> Path:
    (code,) = re.findall(r"## Add an effect\n.*?```python\n(.*?)```", PAGE, re.DOTALL)
    path = tmp_path / "slip_ring_cogging.py"
    path.write_text(code)
    return path


@pytest.mark.slow(60)
def test_an_effect_of_ones_own_is_a_candidate_of_a_diagnosis(effect: Path, tmp_path: Path, capsys):
    seed = secrets.randbelow(2**31)
    print(f"seed {seed}")
    size = float(10.0 ** np.random.default_rng(seed).uniform(-2.5, -1.7))
    log = tmp_path / "log.rrd"
    words = ["run", "sads", "--controller", "quaternion_pd", "--reference", "slew:0,0,150@3"]
    words += ["--duration", "60", "--seed", str(seed), "--effects", f"{effect}={size}"]
    assert main([*words, "--rrd", str(log)]) == 0

    found = twin.diagnose(log, "sads", effects=[effect])
    assert [cause.effect.name for cause in found.causes] == ["slip_ring_cogging"]
    (cause,) = found.causes
    assert abs(cause.effect.values[0] - size) < 3.0 * cause.half_widths[0]

    extended = twin.extend(found, tmp_path / "extended")
    assert [one.name for one in extended.effects] == ["slip_ring_cogging"]
    assert (tmp_path / "extended" / effect.name).read_text() == effect.read_text()


def test_a_file_that_is_no_effect_is_refused(tmp_path: Path, capsys):
    (tmp_path / "none.py").write_text("")
    words = ["diagnose", "models/dfki_pendulum/logs/sysid", "--effects", str(tmp_path / "none.py")]
    assert main(words) == 2
    assert "defines 0 effects" in capsys.readouterr().err
