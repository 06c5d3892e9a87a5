"""What was held out of a fit is told only where something could be."""

from pathlib import Path

import numpy as np
import pytest

from twin.cli.main import main
from twin.diagnosis.baseline import baseline_of
from twin.diagnosis.residual_test import held_out
from twin.platform import load_platform
from twin.recording import Recording, open_log


@pytest.mark.parametrize(("seconds", "segments"), [(9, 1), (19, 2)])
def test_of_one_segment_nothing_is_held_out(seconds: int, segments: int, tmp_path: Path):
    run = tmp_path / "run.rrd"
    fly = ["run", "sads", "--controller", "quaternion_pd", "--duration", str(seconds)]
    assert main([*fly, "--rrd", str(run)]) == 0
    plain = baseline_of([open_log(run).without_truth()], load_platform("sads"))
    assert plain.bodies[0].grid.segments == segments
    assert np.isfinite(held_out(plain).after) == (segments > 1)


def test_a_short_log_beside_a_long_one_keeps_biases_of_its_own(tmp_path: Path):
    logs: list[Recording] = []
    for seed, seconds in enumerate((19, 9, 30)):
        run = tmp_path / f"{seed}.rrd"
        fly = ["run", "sads", "--controller", "quaternion_pd", "--reference", "multisine"]
        more = ["--duration", str(seconds), "--seed", str(seed), "--rrd", str(run)]
        assert main([*fly, *more]) == 0
        logs.append(open_log(run).without_truth())
    gain = held_out(baseline_of(logs, load_platform("sads")))
    assert gain.after < 1.0 + 2.0 * (gain.high - 1.0), "a true model strays"


@pytest.mark.parametrize(
    ("platform", "law", "reference"),
    [
        ("sads", "quaternion_pd", "slew:5,-5,60@6"),
        ("whorl1", "quaternion_pd", "slew:0,0,40@5"),
        ("tas2", "cmg_pd", "multisine:3"),
    ],
)
def test_a_short_log_of_a_true_model_is_not_missed(flight_of, drawn_seed, platform, law, reference):
    plain = baseline_of(
        [flight_of(platform, law, reference, 20.0, drawn_seed)], load_platform(platform)
    )
    assert plain.bodies[0].grid.segments == 2
    held = held_out(plain)
    # a false alarm in less than a thousand logs
    assert held.after < 1.0 + 3.3 / 1.96 * (held.high - 1.0)
