"""What was held out of a fit is told only where something could be."""

from pathlib import Path

import numpy as np
import pytest

from twin.cli.main import main
from twin.diagnose.diagnosis import plain_of
from twin.diagnose.held_out import held_out
from twin.platform import load_platform
from twin.recording import open_log


@pytest.mark.parametrize(("seconds", "segments"), [(9, 1), (19, 2)])
def test_of_one_segment_nothing_is_held_out(seconds: int, segments: int, tmp_path: Path):
    run = tmp_path / "run.rrd"
    fly = ["run", "sads", "--controller", "quaternion_pd", "--duration", str(seconds)]
    assert main([*fly, "--rrd", str(run)]) == 0
    plain = plain_of([open_log(run).without_truth()], load_platform("sads"))
    assert plain.bodies[0].grid.segments == segments
    assert np.isfinite(held_out(plain).after) == (segments > 1)
