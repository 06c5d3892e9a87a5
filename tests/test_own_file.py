"""A file that somebody brings works wherever the rest of the twin does."""

import pickle
import subprocess
import sys

import pytest

from tests.processes import PATIENCE
from twin.cli.main import main
from twin.files import import_alone
from twin.recording import open_log

EFFECT = '''
from dataclasses import dataclass

from twin.effects import SensorLaw, parameter


@dataclass(frozen=True)
class Shear(SensorLaw):
    """Two axes that lean towards each other."""

    name = "shear"
    observable = "a rate about y shows about x"
    streams = ("gyro",)
    acts_on = "gyro"
    products = (("x", ("gyro_y",)),)

    lean: float = parameter("of y", "1", 0.05, source="any")
'''


@pytest.fixture
def path(tmp_path):
    found = tmp_path / "my shear.py"
    found.write_text(EFFECT, encoding="utf-8")
    return found


def test_what_is_made_of_it_can_be_sent_to_another_process(path):
    sent = pickle.dumps(import_alone(path).Shear(lean=0.07))
    read = "import pickle, sys; print(pickle.loads(sys.stdin.buffer.read()).lean)"
    command = [sys.executable, "-c", read]
    told = subprocess.run(command, input=sent, capture_output=True, check=True, timeout=PATIENCE)
    assert told.stdout.decode().strip() == "0.07"


def test_what_it_raises_passes_through_and_it_is_tried_anew_when_mended(path):
    path.write_text("raise ValueError('broken')", encoding="utf-8")
    with pytest.raises(ValueError, match="broken"):
        import_alone(path)
    path.write_text(EFFECT, encoding="utf-8")
    assert import_alone(path).Shear(lean=0.05).lean == 0.05


def test_it_is_run_again_only_when_it_has_changed(path):
    once = import_alone(path)
    assert import_alone(path) is once
    path.write_text(EFFECT.replace("lean towards", "bend from"), encoding="utf-8")
    assert import_alone(path).Shear.__doc__ == "Two axes that bend from each other."
    assert once.Shear.__doc__ == "Two axes that lean towards each other."


def test_a_run_with_an_effect_of_ones_own_is_recorded(path, tmp_path):
    run = tmp_path / "run.rrd"
    given = ["--effects", str(path), "--duration", "3", "--rrd", str(run)]
    assert main(["run", "sads", *given]) == 0
    assert "gyro" in open_log(run)
