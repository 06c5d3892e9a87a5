"""Manoeuvres of a lab's own: what tables and waves promise, and what is refused."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

import twin
from twin.controller import OpenLoop
from twin.errors import LogError, UsageError
from twin.manoeuvre import AttitudeTable, TorqueTable, parse_torque, parse_waves
from twin.platform import load_platform
from twin.reference import parse_reference
from twin.rotation import conjugate, from_euler_zyx, multiply, to_euler_zyx, to_rotation_vector

WAVES = [
    "sine:x,y,10@0.05",
    "sine:x,10@20s+sine:y,10@20s,90",
    "square:x,5@20s+square:z,8@30s,45",
    "chirp:y,z,5@0.01,0.2,40",
]


def written(path: Path, header: str, rows: np.ndarray) -> str:
    np.savetxt(path, rows, delimiter=",", header=header, comments="")
    return str(path)


def swing(time: np.ndarray) -> np.ndarray:
    """(m, 4): a multisine about each axis, from its own reference."""
    return parse_reference("multisine:8").at(time).attitude


@pytest.mark.parametrize("text", WAVES)
def test_waves_have_the_exact_rate_and_acceleration_and_begin_at_rest(text):
    reference, h = parse_reference(text), 1e-4
    times = np.linspace(0.013, 90.0, 977)
    before, now, after = (reference.at(times + step) for step in (-h, 0.0, h))
    turn = to_rotation_vector(multiply(conjugate(before.attitude), after.attitude)) / (2.0 * h)
    np.testing.assert_allclose(turn, now.rate_body, atol=1e-6)
    growth = (after.rate_body - before.rate_body) / (2.0 * h)
    np.testing.assert_allclose(growth, now.acceleration_body, atol=1e-4)
    start = reference.at(0.0)
    np.testing.assert_array_equal(start.attitude, [1.0, 0.0, 0.0, 0.0])
    np.testing.assert_array_equal([start.rate_body, start.acceleration_body], 0.0)


def test_a_sine_is_the_sine_of_its_numbers_on_its_axes_alone():
    time = np.linspace(20.0, 80.0, 601)
    angles = to_euler_zyx(parse_reference("sine:y,10@0.05,30").at(time).attitude)
    wanted = np.radians(10.0) * np.sin(2.0 * np.pi * 0.05 * time + np.radians(30.0))
    np.testing.assert_allclose(angles[:, 1], wanted, atol=1e-12)
    np.testing.assert_allclose(angles[:, [0, 2]], 0.0, atol=1e-15)


def test_a_chirp_sweeps_evenly_and_stays_at_its_last_frequency():
    (wave,) = parse_waves("chirp:x,1@0.1,0.5,40", "torque")
    time = np.linspace(0.0, 40.0, 401)
    swept = np.sin(2.0 * np.pi * (0.1 * time + 0.005 * time**2))
    np.testing.assert_allclose(wave.value(time), swept, atol=1e-12)
    later = np.linspace(45.0, 60.0, 151)
    np.testing.assert_allclose(wave.value(later), wave.value(later + 2.0), atol=1e-10)


def test_a_square_wave_is_at_its_amplitude_but_for_its_flanks():
    reference = parse_reference("square:x,5@20s")
    roll = np.degrees(to_euler_zyx(reference.at(np.arange(2.0, 10.0, 0.1)).attitude)[:, 2])
    np.testing.assert_allclose(roll, 5.0, atol=1e-9)
    roll = np.degrees(to_euler_zyx(reference.at(np.arange(12.0, 20.0, 0.1)).attitude)[:, 2])
    np.testing.assert_allclose(roll, -5.0, atol=1e-9)


def test_a_table_is_met_at_its_rows_and_held_before_and_after(tmp_path):
    rng = np.random.default_rng(7)
    time = np.cumsum(rng.uniform(1.0, 9.0, 12))
    angles = rng.uniform(-0.4, 0.4, (12, 3))
    rows = np.column_stack([time, np.degrees(angles)])
    header = "time,roll [deg],pitch [deg],yaw [deg]"
    reference = parse_reference(written(tmp_path / "own.csv", header, rows))
    roll, pitch, yaw = angles.T
    wanted = from_euler_zyx(yaw, pitch, roll)
    met = reference.at(time)
    np.testing.assert_allclose(np.abs((met.attitude * wanted).sum(axis=1)), 1.0, atol=1e-14)
    for outside in (time[0] - 1.0, time[0], time[-1], time[-1] + 50.0):
        held = reference.at(outside)
        np.testing.assert_array_equal([held.rate_body, held.acceleration_body], 0.0)
    np.testing.assert_array_equal(reference.at(time[-1] + 9.0).attitude, met.attitude[-1])


def test_rate_and_acceleration_of_a_table_are_continuous_and_exact(tmp_path):
    rng = np.random.default_rng(8)
    time = np.arange(0.0, 60.0, 5.0)
    rows = np.column_stack([time, rng.uniform(-0.5, 0.5, (12, 3))])
    reference = parse_reference(written(tmp_path / "own.csv", "t,roll,pitch,yaw", rows))
    inside, h = time[1:-1], 1e-6
    before, after = reference.at(inside - h), reference.at(inside + h)
    np.testing.assert_allclose(before.rate_body, after.rate_body, atol=1e-6)
    np.testing.assert_allclose(before.acceleration_body, after.acceleration_body, atol=1e-6)
    times, h = np.linspace(0.3, 54.0, 499), 1e-4
    before, now, after = (reference.at(times + step) for step in (-h, 0.0, h))
    turn = to_rotation_vector(multiply(conjugate(before.attitude), after.attitude)) / (2.0 * h)
    np.testing.assert_allclose(turn, now.rate_body, atol=1e-8)
    growth = (after.rate_body - before.rate_body) / (2.0 * h)
    np.testing.assert_allclose(growth, now.acceleration_body, atol=1e-4)


@pytest.mark.parametrize("rated", [False, True])
def test_a_motion_comes_back_from_its_table(tmp_path, rated):
    time = np.arange(0.0, 120.01, 0.5)
    truth = parse_reference("multisine:8").at(time)
    columns, header = [time, truth.attitude], "time,q_w,q_x,q_y,q_z"
    if rated:
        columns, header = [*columns, truth.rate_body], f"{header},rate_x,rate_y,rate_z"
    path = written(tmp_path / "own.csv", header, np.column_stack(columns))
    between = np.linspace(1.0, 119.0, 701)
    wanted, came = parse_reference("multisine:8").at(between), parse_reference(path).at(between)
    error = to_rotation_vector(multiply(conjugate(wanted.attitude), came.attitude))
    inner = slice(40, -40)  # the clamped ends of a motion that goes on
    assert np.abs(error[inner]).max() < 2e-5
    np.testing.assert_allclose(came.rate_body[inner], wanted.rate_body[inner], atol=2e-4)


def test_a_table_says_the_same_in_every_format_and_unit(tmp_path):
    time = np.arange(0.0, 30.0, 1.0)
    angles = to_euler_zyx(swing(time))
    frame = {"t_ms": time * 1e3, "pitch [deg]": np.degrees(angles[:, 1])}
    frame |= {"roll [mrad]": angles[:, 2] * 1e3, "yaw": angles[:, 0]}
    parquet.write_table(pa.table(frame), tmp_path / "own.parquet")
    plain = np.column_stack([time, swing(time)])
    other = written(tmp_path / "own.csv", "time,w,x,y,z", plain)
    at = np.linspace(-1.0, 31.0, 97)
    one = parse_reference(str(tmp_path / "own.parquet")).at(at)
    two = parse_reference(other).at(at)
    np.testing.assert_allclose(one.attitude, two.attitude, atol=1e-12)


REFUSED = {
    "time,a,b,c\n0,1,0,0\n": "has no attitude among its columns time, a, b, c",
    "time,roll,pitch,yaw\n0,0,0,0\n9,20,0,0\n": r":3: its angles reach 20.*\[deg\]",
    "time,w,x,y,z\n0,1,0,0,0\n9,1,0,0,0\n8,1,0,0,0\n": ":4: its time 8 s follows 9 s",
    "time,w,x,y,z\n0,1,0,0,0\n9,1,abc,0,0\n": ":3: column 'x'",
    "time,w,x,y,z\n0,1,0,0,0\n9,0,0,0,0\n": ":3: attitude has a quaternion of length 0",
    "time,w,x,y,z\n0,1,0,0,0\n9,0,0,0,1\n": ":3: turns by 180 deg from the row before",
    "time,w,x,y,z\n1.7e9,1,0,0,0\n": "count from the start of the flight",
    "time,roll [m],pitch,yaw\n0,0,0,0\n": "is in 'm', which is no unit of rad",
    "time,w,x,y,z,rate_x,rate_y,rate_z\n0,1,0,0,0,0,0,0\n9,0.99,0.14,0,0,5,0,0\n": (
        "rate_x, rate_y, rate_z are not the rate of its attitude"
    ),
    "time,a_w,a_x,a_y,a_z,b_w,b_x,b_y,b_z\n0,1,0,0,0,1,0,0,0\n": "states a_w.* or b_w",
}


@pytest.mark.parametrize("content", REFUSED)
def test_a_table_that_is_none_is_refused_with_file_and_line(tmp_path, content):
    path = tmp_path / "own.csv"
    path.write_text(content)
    with pytest.raises(LogError, match=rf"own\.csv.*{REFUSED[content]}"):
        AttitudeTable.read(path)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("sine:x,10", "should be a wave"),
        ("sine:q,10@1", "should be a wave"),
        ("sine:x,ten@1", "'ten' should be an amplitude"),
        ("sine:x,50@1+sine:x,41@2", "swings by 91 deg about x"),
        ("sine:x,5@0", "above 0"),
        ("square:x,5@1,2,3", "stand 3 numbers"),
        ("chirp:x,5@1,2", "stand 2 numbers"),
        ("nosuch.csv", "is no file"),
    ],
)
def test_waves_that_are_none_are_told_what_would(text, sentence):
    with pytest.raises((UsageError, LogError), match=sentence):
        parse_reference(text)


def test_the_impulse_of_a_torque_table_is_kept_whatever_the_tick(tmp_path):
    rng = np.random.default_rng(9)
    time = np.cumsum(rng.uniform(0.001, 0.9, 40))
    torque = rng.normal(size=(40, 3))
    torque[-1] = 0.0
    rows = np.column_stack([time, torque])
    profile = TorqueTable.read(Path(written(tmp_path / "own.csv", "t,tx,ty,tz", rows)))
    ticks = np.arange(0.0, time[-1] + 0.1, 0.05)
    given = sum(profile.mean(t, t + 0.05) * 0.05 for t in ticks)
    np.testing.assert_allclose(given, (torque[:-1] * np.diff(time)[:, None]).sum(axis=0))


@pytest.mark.parametrize("name", ["sads", "whorl1:thrusters", "tas2"])
def test_an_open_loop_torque_gives_a_balanced_body_its_impulse(name):
    name, _, actuators = name.partition(":")
    machine = load_platform(name)
    machine = replace(machine, center_of_mass_offset=np.zeros(3), effects=())
    profile, _ = parse_torque("square:z,0.02@20s")
    run = twin.fly(machine, OpenLoop(profile, actuators), duration=5.0, estimator="passthrough")
    rate = run.recording["truth_rate"].value[-1]
    inertia = np.array(machine.inertia)
    spins = actuators == "" and not machine.gimbals
    for wheel in machine.wheels if spins else ():
        inertia = inertia - wheel.inertia * np.outer(wheel.axis, wheel.axis)
    began = run.recording["truth_rate"].time[
        np.argmax(np.abs(run.recording["truth_rate"].value[:, 2]) > 0.0)
    ]
    impulse = 0.02 * (5.0 - began + machine.tick)
    assert (inertia @ rate)[2] == pytest.approx(impulse, rel=0.02)
    assert np.abs((inertia @ rate)[:2]).max() < 0.03 * impulse


def test_a_torque_flies_in_place_of_a_law_alone():
    with pytest.raises(UsageError, match="in place of a law"):
        twin.fly("sads", "quaternion_pd", torque="sine:x,0.1@1")
    with pytest.raises(UsageError, match="neither a table"):
        twin.fly("sads", torque="nothing")


def test_a_flight_is_as_long_as_its_table(tmp_path):
    rows = np.array([[0.0, 0, 0, 0], [3.0, 0.02, 0, 0]])
    path = written(tmp_path / "own.csv", "time,roll,pitch,yaw", rows)
    run = twin.fly("sads", "quaternion_pd", reference=path, keep=False)
    assert run.outcome.duration == pytest.approx(3.0)
