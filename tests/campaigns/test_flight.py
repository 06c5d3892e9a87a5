"""Runs of a campaign, flown: the same bits in any company, and a reason where one fails."""

from dataclasses import replace

import numpy as np
import pytest

from twin.campaigns import flight
from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.controller import load_controller
from twin.errors import ControllerError
from twin.files import trust_folders
from twin.platform import load_platform

ARMS = """
[[arms]]
name = "mixed"

[[arms]]
name = "masses"
controller = "mass_pid"
"""

BALANCE = """
platform = "cubesat"
procedure = "balance"
controller = "direct"
runs = 2
duration = 300.0
seed = 3

[initial]
center_of_mass_offset = "within_reach"

[effects.gyro_bias]
"""


def test_a_run_has_the_same_bits_alone_as_among_others(spec_of):
    spec = spec_of(("[gains]", ARMS + "[gains]"), ("grid = [1e-3, 2e-3]", "uniform = [1e-3, 2e-3]"))
    every = flown(spec, draw(spec, range(24)))
    assert len(every) == 24
    for run in (0, 1, 11, 23):
        assert flown(spec, draw(spec, [run]))[run] == every[run]
    some = flown(spec, draw(spec, [3, 8, 9]))
    assert all(some[run] == every[run] for run in some)


def test_a_sobol_campaign_of_another_law_gives_other_numbers(spec_of):
    one, other = spec_of(), spec_of(("mass_magnetic_pid", "mass_pid"))
    before, after = (flown(spec, draw(spec, range(4))) for spec in (one, other))
    assert before[0].metrics["in_plane_rms"] != after[0].metrics["in_plane_rms"]
    assert all(run.ended == "done" and np.isfinite(run.duration) for run in before.values())


def test_a_run_whose_machine_cannot_be_is_a_row_with_a_reason(spec_of):
    spec = spec_of(("[2e-5, 2e-5, -1e-4]] }", "[2e-5, 2e-5, 0.9]] }"), ("hangs = true\n", ""))
    came = flown(spec, draw(spec, range(24)))
    failed = {run: one for run, one in came.items() if one.ended == "failed"}
    assert 0 < len(failed) < 24
    for run, one in failed.items():
        assert "no rigid body" in one.reason or "cannot be met" in one.reason, one.reason
        assert all(np.isnan(value) for value in one.metrics.values())
        assert str(flown(spec, draw(spec, [run]))[run]) == str(one)
    good = next(run for run in came if run not in failed)
    assert flown(spec, draw(spec, [good]))[good] == came[good]


def test_runs_of_a_law_that_gives_up_are_no_results(spec_of, monkeypatch):
    law = load_controller("mass_magnetic_pid")
    monkeypatch.setattr(type(law), "lost", lambda self, state: "it has given up")
    spec = spec_of()
    with pytest.raises(ControllerError, match="it has given up"):
        flown(spec, draw(spec, range(4)))


def test_a_run_that_diverges_is_a_row_with_a_reason(spec_of):
    rate = "rate = { uniform = [[-1e-3, -1e-3, 0.0], [1e-3, 1e-3, 2400.0]] }\nhangs"
    spec = spec_of(("hangs", rate))
    came = flown(spec, draw(spec, range(24)))
    ends = {one.ended for one in came.values()}
    assert ends == {"done", "failed"}
    for one in came.values():
        if one.ended == "failed":
            assert "the run has diverged (at " in one.reason
            assert one.duration <= 1.0
            assert all(np.isnan(value) for value in one.metrics.values())


def test_a_run_that_diverges_lasts_until_its_plant_stopped_it(spec_of):
    rate = "rate = { uniform = [[0.0, 0.0, 2300.0], [0.0, 0.0, 2400.0]] }\nhangs"
    spec = spec_of(("hangs", rate))
    arm = spec.arms[0]
    slower = replace(arm.platform, control_rate=30.0, step=1.0 / 90.0)
    spec = replace(spec, arms=(replace(arm, platform=slower),))
    for one in flown(spec, draw(spec, range(2))).values():
        assert one.ended == "failed"
        ticks = one.duration * slower.control_rate
        assert ticks == pytest.approx(round(ticks), abs=1e-9), "no time read in a sentence, in ms"


@pytest.mark.parametrize("steady", ["0.95", "0.65"])
def test_rounding_does_not_decide_which_ticks_are_at_the_end(spec_of, steady):
    windows = (f"duration = 2.0\nsteady = 1{steady[1:]}{more}" for more in ("", "0000000001"))
    specs = [spec_of(("duration = 1.0", window)) for window in windows]
    came, wider = (flown(spec, draw(spec, range(2))) for spec in specs)
    # 2 - 1.95 is larger than the first tick at 0.05 s, and that tick is a steady one all the same
    assert came == wider, "some metric is averaged over a tick less than others are"


DRIFTING = """
platform = "sads"
controller = "quaternion_pd"
runs = 3
duration = 2.0
seed = 1

[effects.center_of_mass_drift]
rate = { uniform = [-1e-2, 1e-2] }
"""


def test_a_centre_of_mass_that_drifts_away_is_no_balanced_table(spec_of):
    spec = spec_of(text=DRIFTING)
    drawn = draw(spec, range(3))
    rate = np.stack([drawn.values[f"effects.center_of_mass_drift.rate_{i}"] for i in "xyz"], axis=1)
    came, platform = flown(spec, drawn), spec.arms[0].platform
    for run, one in came.items():
        moment = platform.center_of_mass_offset + one.duration * rate[run]
        for metric, axes in (("gravity_torque", 3), ("gravity_torque_in_plane", 2)):
            torque = platform.gravity * np.linalg.norm(moment[:axes])
            np.testing.assert_allclose(one.metrics[metric], torque, rtol=1e-9)


MACHINES = {
    "dfki_pendulum": ("free_float", "[initial]\njoint_angle = { uniform = [0.1, 0.5] }\n"),
    "sads": (
        "quaternion_pd",
        "[gains]\nproportional = { log_uniform = [1, 10] }\n[effects.liquid_slosh]\n"
        "[effects.wheel_friction]\n[effects.room_draft]\n[effects.clock_lag.gyro]\nlag = 0.01\n",
    ),
    "tas2": ("cmg_pd", "[effects.gimbal_friction]\n[effects.gimbal_backlash]\n"),
    "astros": ("thruster_pd", "[initial]\nattitude = { normal = [0, 0.02] }\n"),
    "whorl2": ("free_float", "[initial]\nrate = { normal = [0, 0.02] }\n"),
}


@pytest.mark.parametrize("machine", MACHINES)
def test_a_campaign_flies_on_every_kind_of_machine(machine, spec_of):
    law, rest = MACHINES[machine]
    head = f'platform = "{machine}"\ncontroller = "{law}"\nruns = 4\nduration = 0.5\nseed = 1\n'
    spec = spec_of(text=head + rest)
    every = flown(spec, draw(spec, range(4)))
    assert repr(flown(spec, draw(spec, [2]))[2]) == repr(every[2]), "NaN where no wheel was full"
    assert {one.ended for one in every.values()} == {"done"}
    assert len({repr(one.metrics) for one in every.values()}) == 4


LAWS = {
    "quaternion_pd": ("sads", ["proportional", "derivative"]),
    "mass_pid": ("cubesat", ["proportional", "integral", "derivative"]),
    "mass_magnetic_pid": ("cubesat", ["proportional", "integral", "derivative"]),
    "magnetic_damping": ("cubesat", ["derivative"]),
    "cmg_pd": ("tas2", ["proportional", "derivative"]),
}


@pytest.mark.parametrize("name", LAWS)
def test_gains_that_differ_fly_in_one_batch(name, spec_of):
    machine, gains = LAWS[name]
    law = load_controller(name)
    assert flight._passes(law, load_platform(machine), gains), "no Python for each run"


OWN = """
from dataclasses import dataclass, field
import math
import numpy as np
from twin.controller import Controller

@dataclass(frozen=True)
class Own(Controller[int]):
    gain: float = field(default=1.0, metadata={"unit": "1"})
    def __post_init__(self):
        object.__setattr__(self, "once", 1e-3 * self.gain)
    def init(self, platform, n):
        return n
    def update(self, state, estimate, target, time):
        return {"command_dipole": np.full((state, 3), DIPOLE)}, state
"""
DIPOLES = {"that takes no columns": "1e-3 * math.tanh(self.gain)", "made with them": "self.once"}


@pytest.mark.parametrize("kind", DIPOLES)
def test_a_law_that_cannot_have_its_gains_as_columns_flies_in_batches(kind, tmp_path, spec_of):
    path = tmp_path / "own.py"
    path.write_text(OWN.replace("DIPOLE", DIPOLES[kind]), encoding="utf-8")
    trust_folders(tmp_path)
    spec = spec_of(
        ('"mass_magnetic_pid"', repr(str(path))),
        ("derivative = { grid = [1e-3, 2e-3] }", "gain = { uniform = [1.0, 2.0] }"),
    )
    drawn = draw(spec, range(4))
    gains = {"gain": drawn.values["gains.gain"]}
    assert flight.batches(spec.arms[0], gains, 4) == [[0], [1], [2], [3]]
    came = flown(spec, drawn)
    assert len({one.metrics["rate_rms"] for one in came.values()}) == 4


@pytest.mark.slow(60)
def test_a_balancing_has_the_same_bits_alone_as_among_others(spec_of):
    spec = spec_of(text=BALANCE)
    every = flown(spec, draw(spec, range(2)))
    assert every[1].metrics["identified"] >= 1.0, "its masses were moved by a fit"
    (alone,) = flown(spec, draw(spec, [1])).values()
    assert repr(alone) == repr(every[1]), "what was not reached is no number"


def test_a_run_that_would_start_beyond_its_stop_is_a_row_with_a_reason(spec_of):
    spec = spec_of(("hangs = true\n", "attitude = { uniform = [-0.6, 0.6] }\n"))
    stop = spec.arms[0].platform.stop_angle
    drawn = draw(spec, range(24))
    came = flown(spec, drawn)
    roll, pitch = (drawn.values[f"initial.attitude.{axis}"] for axis in ("roll", "pitch"))
    beyond = np.arccos(np.cos(roll) * np.cos(pitch)) > stop
    assert 0 < beyond.sum() < 24
    for run, one in came.items():
        assert (one.ended == "failed") == beyond[run]
        assert ("beyond the stop at" in one.reason) == beyond[run]
