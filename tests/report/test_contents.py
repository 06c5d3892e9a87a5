"""`twin show`: what is in a log, in words, as JSON and drawn."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.processes import PATIENCE
from twin import rotation
from twin.cli.main import main
from twin.library import library
from twin.platform import load_platform, taken_as_at_rest
from twin.recording import Recording, Series, open_log, write_folder
from twin.report.contents import contents_document, contents_of, contents_words

PENDULUM = library("models") / "dfki_pendulum" / "logs" / "sysid"
XYZ = ("x", "y", "z")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A gyro with two gaps, an attitude turning about the vertical, a stage that stands still."""
    generator = np.random.default_rng(5)
    time = np.arange(3000) / 100.0
    time = time[((time < 10.0) | (time > 10.055)) & ((time < 20.0) | (time > 20.5))]
    gyro = generator.normal(0.0, 1e-3, (len(time), 3)) + np.array([0.0, 0.0, 0.1])
    turned = np.zeros((600, 3))
    turned[:, 2] = np.linspace(0.0, 3.0, 600)
    turns = rotation.from_rotation_vector(turned)
    fine = np.arange(600) / 20.0
    streams = {
        "gyro": Series(time, gyro, XYZ, "rad/s"),
        "attitude": Series(fine, turns, ("w", "x", "y", "z"), "1"),
        "stage_position": Series(fine, np.full((600, 1), 0.02), ("s1",), "m"),
        "command_wheel_torque": Series(fine, 0.1 * np.sign(turns[:, :1] - 0.5), ("w1",), "N m"),
    }
    facts = {"platform": "nowhere", "notes": {"operator": "Ada"}}
    write_folder(Recording(streams, facts), tmp_path / "log")
    return tmp_path / "log"


def test_the_words_name_rows_rates_gaps_ranges_and_noise(folder: Path, capsys):
    assert main(["show", str(folder)]) == 1  # there is no platform nowhere
    text = capsys.readouterr().out
    assert f"{folder}: a measured log on nowhere, 30 s, 4 streams\n  operator: Ada\n" in text
    assert (
        "gyro: 2943 rows from 0.000 to 29.990 s, 100 Hz, no jitter, 2 gaps, the longest of 0.52 s "
        "at 19.990 s\n" in text
    )
    assert "attitude: 600 rows from 0.000 to 29.950 s, 20 Hz, no jitter, no gap\n" in text
    assert "    yaw 0 to 172, pitch 0, roll 0 deg\n" in text
    assert "    s1 20 mm (stands still)\n" in text
    assert "    w1 -0.1 to 0.1 N m\n" in text
    noise = text.split("    noise ")[1].split(" deg/s")[0]
    np.testing.assert_allclose([float(x) for x in noise.split(",")], np.rad2deg(1e-3), rtol=0.1)


def test_a_gyro_at_rest_tells_its_slow_noise_in_words_and_as_json():
    draw = np.random.default_rng(3)
    white, steps = draw.standard_normal((2, 60_000, 3))
    rate = 1e-3 * white + np.cumsum(5e-6 * steps, axis=0)
    log = Recording({"gyro": Series(np.arange(60_000) / 100.0, rate, XYZ, "rad/s")}, {})
    contents = contents_of("bench", log, None)
    (line,) = (one for one in contents_words(contents).splitlines() if "at rest" in one)
    assert "from 0.0 to 600.0 s: random walk" in line
    assert "rate random walk" in line
    (gyro,) = contents_document(contents)["streams"]
    np.testing.assert_allclose(gyro["at_rest"]["random_walk"], 1e-4, rtol=0.05)
    np.testing.assert_allclose(gyro["at_rest"]["rate_random_walk"], 5e-5, rtol=0.5)


def test_what_the_machine_lacks_or_has_more_of_is_said(folder: Path):
    log, sads = open_log(folder), load_platform("sads")
    felt = Series(log["gyro"].time, log["gyro"].value, XYZ, "m/s^2")
    speed = Series(log["gyro"].time, np.zeros((len(log["gyro"]), 4)), tuple("abcd"), "rad/s")
    streams = {"gyro": log["gyro"], "accelerometer": felt, "wheel_speed": speed}
    told = contents_of("a log", replace(log, streams=streams), sads).findings
    assert any("sads states no accelerometer: that of this log has no part" in one for one in told)
    assert any("The log's wheel_speed has 4 columns (a, b, c, d)" in one for one in told)


def test_parts_without_any_stream_are_said_to_be_taken_as_at_rest(folder: Path):
    log = open_log(folder)
    platform = load_platform("sads")
    seen = Recording({"gyro": log["gyro"], "attitude": log["attitude"]}, log.provenance)
    said = contents_of("a log", seen, platform).findings
    wheels = [sentence for sentence in said if "wheels" in sentence]
    names = platform.columns("wheel_speed")
    assert wheels == [
        f"sads has wheels {names[0]} to {names[-1]}; this log has neither their speed nor their "
        "torque: taken as at rest. Unless that is so, add wheel_speed or command_wheel_torque."
    ]
    assert any("add stage_position or command_stage_position" in sentence for sentence in said)
    told = " ".join(contents_of("", log, platform).findings)
    assert "wheels" not in told, "what commands them is in this log"
    assert "stages" not in told
    flown = replace(seen, provenance={})
    assert taken_as_at_rest([flown], platform) == (), "a recording of ours holds every command"
    together = taken_as_at_rest([seen, seen], platform)
    assert all(f"; {folder} has n" in sentence for sentence in together)


def test_a_stream_that_nothing_uses_is_said_with_the_name_that_was_meant(folder: Path):
    log = open_log(folder)
    streams = {"gyroscope": log["gyro"], "attitude": log["attitude"], "oven_door": log["gyro"]}
    assert contents_of("a log", Recording(streams, log.provenance), None).findings == (
        "Nothing uses gyroscope, a stream of a name that we do not know: did you mean 'gyro'?",
        "Nothing uses oven_door, a stream of a name that we do not know.",
    )


def test_the_document_holds_the_same_in_si(folder: Path, capsys):
    assert main(["show", str(folder), "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["notes"] == {"operator": "Ada"}
    streams = {stream["name"]: stream for stream in document["streams"]}
    gyro = streams["gyro"]
    assert (gyro["rows"], gyro["unit"]) == (2943, "rad/s")
    assert gyro["rate"] == pytest.approx(100.0)
    assert gyro["gaps"]["count"] == 2
    assert gyro["gaps"]["samples_lost"] == 57
    np.testing.assert_allclose(gyro["gaps"]["at"], [[19.99, 20.51], [9.99, 10.06]])
    np.testing.assert_allclose(gyro["noise"], 1e-3, rtol=0.1)
    assert gyro["columns"][2]["min"] == pytest.approx(0.1, abs=0.005)
    assert streams["command_wheel_torque"]["noise"] is None
    assert streams["stage_position"]["noise"] is None
    assert gyro["stated"]["file"] == "gyro.csv"


def test_repairs_and_findings_are_printed(tmp_path: Path, capsys):
    generator = np.random.default_rng(6)
    rows = [f"{i / 100},{x:.5f}\n" for i, x in enumerate(generator.normal(0.0, 0.01, 2000))]
    rows[50:52] = [",\n", "0.51,\n"]
    (tmp_path / "g.csv").write_text("t,x\n" + "".join(rows))
    (tmp_path / "log.toml").write_text(
        'platform = "sads"\n[streams.gyro]\nfile = "g.csv"\naxes = ["x"]\nnoise = 1e-3\n'
    )
    assert main(["show", str(tmp_path)]) == 0
    text = capsys.readouterr().out
    assert "  repaired: gyro (g.csv): 2 rows without a number left out\n" in text
    assert "that the log states." in text


def test_values_whose_scale_is_to_be_fitted_stay_in_their_own_unit(tmp_path: Path, capsys):
    (tmp_path / "g.csv").write_text("x\n" + "".join(f"{i % 7}\n" for i in range(500)))
    (tmp_path / "log.toml").write_text(
        'platform = "sads"\n[streams.gyro]\nfile = "g.csv"\nrate = 10\naxes = ["x"]\n'
        'unit = "mV"\nscale = "fit"\n'
    )
    assert main(["show", str(tmp_path)]) == 0
    assert "    x 0 to 0.006 V (its scale is to be fitted)\n" in capsys.readouterr().out


def test_a_recording_without_rows_or_with_one_is_shown(tmp_path: Path, capsys):
    from twin.report.contents import contents_document, contents_of, contents_words
    from twin.report.picture import draw_contents

    one = Series(np.array([1.0]), np.ones((1, 3)), XYZ, "rad/s")
    none = Series(np.empty(0), np.empty((0, 3)), XYZ, "T")
    contents = contents_of("a", Recording({"gyro": one, "magnetometer": none}), None)
    assert contents_words(contents).endswith("gyro: 1 row\n\nmagnetometer: no rows")
    assert contents_document(contents)["streams"][1]["columns"] == []
    draw_contents(contents, tmp_path / "a.png")
    assert (tmp_path / "a.png").exists()


@pytest.mark.parametrize("name", ["a.png", "new/a.svg", "a.html"])
def test_the_picture_has_a_panel_a_stream(tmp_path: Path, name: str, capsys):
    picture = tmp_path / name
    assert main(["show", str(PENDULUM), "--picture", str(picture)]) == 0
    content = picture.read_bytes()
    if picture.suffix == ".png":
        assert content.startswith(b"\x89PNG")
    else:
        for stream in ("joint_angle", "joint_rate", "command_joint_torque"):
            assert f">{stream}</text>".encode() in content


def test_a_long_stream_keeps_its_peaks_in_the_picture():
    from twin.report.picture import BINS, _thinned

    time = np.arange(100_000) / 100.0
    value = np.zeros(100_000)
    value[70_001] = 5.0
    value[time > 900.0] = -1.0
    kept = time[(time < 400.0) | (time > 410.0)], value[(time < 400.0) | (time > 410.0)]
    thin_time, thin_value = _thinned(*kept, period=0.01)
    assert len(thin_time) <= 2 * BINS + 10
    assert np.nanmax(thin_value) == 5.0
    assert np.isnan(thin_value[np.searchsorted(thin_time[:500], 400.0) - 5 :]).any()


def test_a_picture_of_another_format_is_wrong_use(capsys):
    assert main(["show", str(PENDULUM), "--picture", "a.gif"]) == 2
    assert "a.gif: a picture ends in one of .png, .svg, .html" in capsys.readouterr().err


def test_a_log_that_cannot_be_read_costs_little_memory(tmp_path: Path):
    (tmp_path / "log.toml").write_text('platform = "sads"\n[streams.gyro]\nfile = "g.csv"\n')
    with (tmp_path / "g.csv").open("wb") as file:
        file.truncate(1 << 30)
    code = (
        "import re, sys\n"
        "from twin.cli.main import main\n"
        "print(main(['show', sys.argv[1]]))\n"
        "print(re.search(r'VmHWM:\\s+(\\d+)', open('/proc/self/status').read())[1])\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path)],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE,
    )
    exit_code, peak = done.stdout.split()
    assert exit_code == "1"
    assert "g.csv:1: holds a line of more than 1 MiB" in done.stderr
    assert int(peak) < 100_000, "kB of memory"


def test_a_command_written_when_it_changes_has_no_gaps():
    """Its value holds until the next row, however long that takes."""
    time = np.arange(300) / 10.0
    gyro = Series(time, np.random.default_rng(0).normal(0.0, 1e-3, (300, 3)), XYZ, "rad/s")
    duty = Series(np.array([0.0, 6.0, 25.0]), np.array([[0.0], [0.5], [0.0]]), ("w1",), "1")
    late = Series(np.delete(time, slice(100, 150)), np.zeros((250, 1)), ("w1",), "N m")
    streams = {"gyro": gyro, "command_wheel_duty": duty, "command_wheel_torque": late}
    contents = contents_of("here", Recording(streams), None)
    words = contents_words(contents)
    assert "command_wheel_duty: 3 rows from 0.000 to 25.000 s, each holds until the next\n" in words
    assert "1 gap of 5.1 s at 9.900 s" in words, "one by a clock has lost rows all the same"
    by_name = {stream.name: stream for stream in contents.streams}
    assert by_name["command_wheel_duty"].gaps == ()
    assert len(by_name["command_wheel_torque"].gaps) == 1


def test_streams_that_share_no_time_are_told_without_a_machine_too():
    def series(start: float) -> Series:
        return Series(start + 0.01 * np.arange(500.0), np.ones((500, 3)), ("x", "y", "z"), "rad/s")

    log = Recording({"gyro": series(1e5), "joint_rates": series(0.0)}, {"kind": "log"})
    assert any("they share no time" in said for said in contents_of("", log, None).findings)


@pytest.mark.parametrize("times", [0.9, 1.2, 9.549])
def test_a_wheel_beyond_its_stated_speed_is_said(times: float, drawn_seed: int):
    draw = np.random.default_rng(drawn_seed)
    platform = load_platform("sads")
    limits = np.array([wheel.speed_limit for wheel in platform.wheels])
    time = np.arange(0.0, 60.0, 0.05)
    fastest = int(draw.integers(len(limits)))
    reach = np.where(np.arange(len(limits)) == fastest, times, 0.5) * limits
    speed = reach * np.sin(0.3 * time)[:, None] + draw.normal(0.0, 0.1, (len(time), len(limits)))
    names = tuple(wheel.name for wheel in platform.wheels)
    log = Recording({"wheel_speed": Series(time, speed, names, "rad/s")}, {"kind": "log"})
    said = [one for one in contents_of("a", log, platform).findings if "momentum_limit" in one]
    if times < 1.0:
        assert said == []
    else:
        (one,) = said
        assert one.startswith(f"{names[fastest]} reaches ")


def test_wheel_speeds_are_printed_in_rpm_and_written_in_rad_per_second():
    speed = np.linspace(0.0, 2.0 * np.pi * 50.0, 500)[:, None]
    log = Recording(
        {"wheel_speed": Series(0.01 * np.arange(500.0), speed, ("w1",), "rad/s")}, {"kind": "log"}
    )
    contents = contents_of("", log, None)
    assert "w1 0 to 3000 rpm" in contents_words(contents)
    (stream,) = contents_document(contents)["streams"]
    assert stream["unit"] == "rad/s"


@pytest.mark.parametrize(("unit", "times"), [("mm", 1e3), ("cm", 1e2)])
def test_a_path_on_a_floor_that_no_thruster_can_bend_is_of_another_unit(unit: str, times: float):
    platform = load_platform("kentucky_planar")
    log = open_log(platform.folder / "logs" / "mission")
    place = replace(log["position"], value=times * log["position"].value)
    wrong = replace(log, streams={**log.streams, "position": place})
    said = [one for one in contents_of("", wrong, platform).findings if "position shows" in one]
    assert len(said) == 1, unit
    assert "the thrusters of kentucky_planar give at most" in said[0]
    assert not any("position shows" in one for one in contents_of("", log, platform).findings)
