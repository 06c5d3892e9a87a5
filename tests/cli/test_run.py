"""`twin run`, as its user meets it."""

import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tests.signals import hear
from twin.budget import momentum_budget
from twin.cli.main import main
from twin.errors import UsageError
from twin.flight import prepare
from twin.metrics import settled
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.recording import open_log


def test_a_balanced_table_is_tracked_and_recorded(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    words = ["sads", "--controller", "quaternion_pd", "--duration", "40", "--rrd", str(out)]
    assert main(["run", *words]) == 0
    told = capsys.readouterr()
    assert "warning" not in told.err
    assert "tracking error" in told.out
    assert f"twin view {out}" in told.out
    recording = open_log(out)
    assert recording.repairs == ()
    assert recording.stop == pytest.approx(40.0)
    assert recording.provenance["seed"] == 0
    assert {"gyro", "attitude", "command_wheel_torque", "truth_attitude"} <= set(recording)


def test_json_is_one_document_and_nothing_else(capsys):
    assert main(["run", "sads", "--controller", "quaternion_pd", "--duration", "2", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert {"ended", "reason", "duration", "overruns"} <= set(document)
    assert document["ended"] == "done"
    assert document["reason"] is None


def test_a_short_run_tells_its_tracking_error_over_its_second_half(capsys):
    assert main(["run", "sads", "--controller", "quaternion_pd", "--duration", "4"]) == 0
    assert "at worst, from 2 s on" in capsys.readouterr().out
    assert (settled(30.0), settled(61.0), settled(1e4)) == (15.0, 30.0, 30.0)


def test_an_unbalanced_table_is_told_before_it_flies_when_its_wheels_will_saturate(capsys):
    words = ["sads:table1", "--controller", "quaternion_pd", "--duration", "100", "--json"]
    assert main(["run", *words]) == 0
    told = capsys.readouterr()
    document = json.loads(told.out)
    (warning,) = document["warnings"]
    assert "the wheels will saturate" in warning
    foretold = float(warning.split(" N m s at ")[1].split(" s of ")[0])
    assert warning in told.err
    assert document["metrics"]["wheel_saturated_at_s"] == pytest.approx(foretold, rel=0.2)


LAW_OF_WHEELS = '''
"""A law that asks wheels for nothing."""

from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class Idle(Controller[int]):
    """Asks for nothing."""

    def init(self, platform, n):
        return len(platform.wheels)

    def update(self, state, estimate, target, time):
        return {"command_wheel_torque": np.zeros((len(estimate.valid), state))}, state
'''


def test_nothing_is_foretold_of_wheels_in_gimbals(tmp_path):
    """What they take depends on where the gimbals stand: as if at angle 0, two would fill."""
    law = tmp_path / "idle.py"
    law.write_text(LAW_OF_WHEELS, encoding="utf-8")
    flight = prepare(
        "astros",
        controller=str(law),
        estimator=None,
        plant="sim",
        reference="hold:20,0,0",
        duration=100.0,
    )
    assert momentum_budget(flight.platform, flight.reference, 100.0).saturates_at is not None
    assert flight.warnings() == []


@pytest.mark.parametrize("reference", ["hold:40,0,0", "slew:0,-35,20@5", "multisine:60@0.05"])
def test_a_reference_beyond_the_stop_is_refused_with_both_angles(capsys, reference):
    words = ["run", "sads", "--controller", "quaternion_pd", "--duration", "60"]
    assert main([*words, "--reference", reference]) == 2
    said = capsys.readouterr().err
    assert f"reference {reference!r} leans sads by " in said
    assert "deg, beyond the stop at 30 deg" in said


def test_a_table_that_falls_onto_its_stop_is_told_to_have_touched_it(capsys):
    words = ["run", "sads", "--controller", "free_float", "--attitude", "25", "0", "0"]
    assert main([*words, "--duration", "100"]) == 0
    assert "largest tilt 30 deg, where it touched its stop" in capsys.readouterr().out


def test_a_turn_about_the_vertical_meets_no_stop():
    names = {"plant": "sim", "estimator": None, "duration": 200.0}
    prepare("sads", controller="quaternion_pd", reference="slew:0,0,170", **names)


@pytest.mark.parametrize(
    ("reference", "follows"),
    [
        (
            "slew:0,0,30",
            "the 30 deg of yaw that the reference asks for and never sees them reached",
        ),
        ("hold:5,0,0", "neither sees the heading drift nor holds it"),
    ],
)
def test_a_heading_that_no_sensor_shows_is_told_before_the_flight(tmp_path, reference, follows):
    law = tmp_path / "idle.py"
    law.write_text(LAW_OF_WHEELS, encoding="utf-8")
    names = {"plant": "sim", "reference": reference, "duration": 200.0}
    flight = prepare("astros", controller=str(law), estimator="inclinometer", **names)
    (warning,) = flight.warnings()
    assert follows in warning
    assert warning.endswith("use the estimator 'filter'")
    sensors = {"inclinometer": flight.platform.sensors["inclinometer"]}
    blind = SimulatedPlant(dataclasses.replace(flight.platform, sensors=sensors))
    (warning,) = dataclasses.replace(flight, plant=blind).warnings()
    assert "give it [sensors.attitude], or a law that needs no heading (mass_pid)" in warning
    for told in ({"estimator": "filter"}, {"controller": "mass_pid"}):
        seen = {"controller": str(law), "estimator": "inclinometer", **names, **told}
        assert prepare("astros", **seen).warnings() == []


LAW_THAT_BREAKS = '''
"""A law that forgets to guard a division."""

from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class Broken(Controller[None]):
    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        with np.errstate(all="ignore"):
            torque = np.float64(0.0) / np.float64(max(3.0 - time, 0.0))
        return {"command_wheel_torque": np.full((len(estimate.valid), 3), torque)}, None
'''


def test_a_run_that_fails_says_why_and_leaves_its_last_two_seconds(tmp_path, capsys):
    law = tmp_path / "broken.py"
    law.write_text(LAW_THAT_BREAKS)
    out = tmp_path / "run.rrd"
    words = ["run", "sads", "--controller", str(law), "--duration", "10", "--rrd", str(out)]
    assert main(words) == 1
    told = capsys.readouterr().out
    assert "failed after 3 s: command_wheel_torque w1 is nan" in told
    record = tmp_path / "run.flight-0.rrd"
    assert str(record) in told
    kept = open_log(record)
    assert kept.start == pytest.approx(1.0, abs=0.051)
    assert np.isnan(kept["wanted_wheel_torque"].value[-1]).all()


def test_a_pendulum_swings_under_no_command(capsys):
    words = ["run", "dfki_pendulum", "--attitude", "60", "0", "0", "--duration", "2", "--json"]
    assert main([*words, "--estimator", "passthrough"]) == 0
    assert json.loads(capsys.readouterr().out)["ended"] == "done"


def test_a_recording_is_replayed_as_if_it_were_hardware(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    law = ["--controller", "quaternion_pd"]
    assert main(["run", "sads", *law, "--duration", "4", "--rrd", str(out)]) == 0
    capsys.readouterr()
    assert main(["run", "sads", *law, "--plant", f"replay:{out}", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["duration"] == pytest.approx(4.0, abs=0.051)


def test_a_recording_of_another_machine_is_replayed_with_a_warning(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    law = ["--controller", "quaternion_pd"]
    assert main(["run", "sads:table1", *law, "--duration", "2", "--rrd", str(out)]) == 0
    capsys.readouterr()
    for machine, warned in (("sads:table1", False), ("sads", True)):
        assert main(["run", machine, *law, "--plant", f"replay:{out}"]) == 0
        told = capsys.readouterr().err
        assert ("the log is of sads:table1, and is replayed as if it were of sads:" in told) is (
            warned
        )


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["nosuch"], "no platform named 'nosuch'"),
        (["sads:nosuch"], "no variant named 'nosuch'"),
        (["sads", "--controller", "quaternion_pid"], "did you mean 'quaternion_pd'"),
        (["sads", "--controller", "my_law.py"], "my_law.py: there is no such file; check the path"),
        (["sads", "--estimator", "kalman"], "no estimator named 'kalman'"),
        (["sads", "--plant", "telnet:COM1"], "no plant named 'telnet:COM1'"),
        (["sads", "--reference", "wobble"], "no reference named 'wobble'"),
        (["sads", "--duration", "-3"], "duration is -3 s"),
        (["sads", "--velocity", "1", "0", "0"], "sads stays where it is, but would start with"),
        (["sads", "--controller", "mass_pid", "--gains", "integral"], "give NAME=VALUE"),
        (["sads", "--controller", "mass_pid", "--gains", "kp=1"], "no gain named 'kp'"),
    ],
)
def test_wrong_use_is_told_in_a_sentence_with_exit_code_2(words, sentence, capsys):
    assert main(["run", *words]) == 2
    assert sentence in capsys.readouterr().err


LAW_WITH_A_MISTAKE = '''"""A law with a mistake."""
from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class Mistaken(Controller[None]):
    """Asks for nothing."""

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        torque = np.zeros((len(estimate.valid), 3))
        return {"command_wheel_torque": torque}, state
'''
_TORQUE = "        torque = np.zeros((len(estimate.valid), 3))\n"
_ANSWER = '{"command_wheel_torque": torque}, state'
_RETURNED = ": line 16: what update returns: "
_WHEELS = "command_wheel_torque"


@pytest.mark.parametrize(
    ("right", "wrong", "sentence"),
    [
        (
            _TORQUE,
            "        torque = estimate.rates\n",
            ": line 17: AttributeError: ",
        ),
        (
            _TORQUE,
            f"{_TORQUE}        1 / (time < 0.5)\n",
            ": line 18: ZeroDivisionError: division by",
        ),
        ("return None", "return platform.size", ": line 14: AttributeError: 'Platform' object has"),
        (_ANSWER, "torque", ": ValueError: "),
        (_ANSWER, "torque, state", ": TypeError: the command is of type ndarray, not a dict"),
        (
            _ANSWER,
            '{"command_wheel_torque": [[0.0] * 3]}, state',
            f"{_RETURNED}{_WHEELS} is of type list",
        ),
        (
            _ANSWER,
            '{"command_wheel_torque": torque + 1j}, state',
            f"{_RETURNED}{_WHEELS} is of type complex128; this platform takes a float64 array",
        ),
        (
            _ANSWER,
            '{"command_wheel_torque": torque[:, 1:]}, state',
            f"{_RETURNED}{_WHEELS} has shape (1, 2)",
        ),
        (_ANSWER, '{"command_torque": torque}, state', f"{_RETURNED}no command channel"),
    ],
    ids=["at once", "later", "in init", "no state", "no dict", "list", "complex", "shape", "name"],
)
def test_a_mistake_in_a_law_of_ones_own_is_told_with_its_line(
    right, wrong, sentence, tmp_path, capsys
):
    law = tmp_path / "mistaken.py"
    law.write_text(LAW_WITH_A_MISTAKE.replace(right, wrong), encoding="utf-8")
    assert main(["run", "sads", "--controller", str(law), "--duration", "1"]) == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert f"{law}{sentence}" in said
    assert said.endswith(f"`twin check {law} --platform sads` says more")


LAW_THAT_IS_STOPPED = '''
"""A law during which the operator presses Ctrl-C."""

import os
import signal
from dataclasses import dataclass

import numpy as np

from twin.controller import Controller


@dataclass(frozen=True)
class Stopped(Controller[None]):
    """Asks for nothing, and is interrupted after a second."""

    def init(self, platform, n):
        return None

    def update(self, state, estimate, target, time):
        if time >= 1.0:
            os.kill(os.getpid(), signal.SIGINT)
        return {"command_wheel_torque": np.zeros((len(estimate.valid), 3))}, state
'''


def test_ctrl_c_closes_the_recording_properly(tmp_path):
    out, law = tmp_path / "out.rrd", tmp_path / "stopped.py"
    law.write_text(LAW_THAT_IS_STOPPED, encoding="utf-8")
    words = ["run", "sads", "--controller", str(law), "--realtime", "--rrd", str(out)]
    done = subprocess.run(
        [sys.executable, "-m", "twin", *words],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        preexec_fn=hear,
    )
    assert done.returncode == 0, done.stderr
    assert "safe_stop" in done.stdout
    assert "stopped by the operator" in done.stdout
    recording = open_log(out)
    assert recording.repairs == ()
    assert recording.stop > 0.5
    verified = subprocess.run(
        [Path(sys.executable).with_name("rerun"), "rrd", "verify", out], timeout=60.0
    )
    assert verified.returncode == 0


@pytest.mark.parametrize(("machine", "law"), [("cubesat", "mass_magnetic_pid"), ("tas2", "cmg_pd")])
def test_a_machine_without_the_attitude_stream_flies_on_what_else_it_measures(capsys, machine, law):
    words = ["run", f"{machine}:imu", "--controller", law, "--attitude", "2", "-1", "0"]
    assert main([*words, "--duration", "3", "--json"]) == 0
    said = capsys.readouterr()
    assert "with estimator mekf" in said.err
    document = json.loads(said.out)
    assert document["metrics"]["tilt_max_rad"] < np.radians(4.0)
    heading = [line for line in document["remarks"] if "no sensor shows the heading" in line]
    assert len(heading) == (machine == "cubesat")


def test_a_law_that_answers_to_what_no_sensor_shows_is_refused_with_what_would_do(capsys):
    words = ["run", "cubesat:imu", "--duration", "2", "--estimator", "passthrough"]
    assert main([*words, "--controller", "mass_magnetic_pid"]) == 2
    said = capsys.readouterr().err
    assert "no sensor of cubesat:imu shows it to the estimator 'passthrough'" in said
    assert said.rstrip().endswith("use the estimator 'mekf'")
    assert main([*words, "--controller", "free_float"]) == 0


def test_the_streams_that_would_do_are_named_where_none_is_measured():
    machine = load_platform("cubesat")
    blind = dataclasses.replace(machine, sensors={"gyro": machine.sensors["gyro"]})
    names = {"plant": "sim", "reference": None, "duration": 1.0, "estimator": None}
    with pytest.raises(UsageError, match=r"\[sensors.attitude\] or \[sensors.inclinometer\]"):
        prepare(blind, controller="mass_magnetic_pid", **names)


def test_a_law_is_warned_of_a_heading_that_the_gyro_alone_carries_only_if_it_answers_to_it():
    names = {"plant": "sim", "reference": None, "duration": 60.0, "estimator": "mekf"}
    assert prepare("cubesat:imu", controller="mass_magnetic_pid", **names).warnings() == []
    machine = load_platform("whorl1")
    kept = {k: v for k, v in machine.sensors.items() if k != "attitude"}
    gyros = dataclasses.replace(machine, sensors=kept)
    flight = prepare(gyros, controller="mrp_tracking", **{**names, "reference": "hold"})
    (warning,) = [line for line in flight.warnings() if "heading" in line]
    assert "carried by the gyro to a sigma of" in warning
