"""`twin import` opens what each maker's program writes, and gives the values that were true."""

import importlib.util
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.errors import LogError
from twin.intake import import_files
from twin.platform import load_platform
from twin.recording import read_log


def _beside(name: str):
    """A module of this folder; tests are no package."""
    spec = importlib.util.spec_from_file_location(name, Path(__file__).with_name(f"{name}.py"))
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


makers = _beside("makers")
LAYOUTS = (*makers.MAKERS, *_beside("devices").DEVICES)
OPENED = [maker for maker in LAYOUTS if not maker.refused]
REFUSED = [maker for maker in LAYOUTS if maker.refused]


@pytest.fixture(scope="module")
def motion(request: pytest.FixtureRequest):
    seed = seed_of(request)
    return makers.motion(seed)


@pytest.mark.parametrize("maker", OPENED, ids=lambda maker: maker.name)
def test_a_file_is_opened_unedited_and_its_values_are_the_sources(maker, motion, tmp_path: Path):
    maker.write(tmp_path / maker.file, motion)
    start = time.process_time()
    import_files([tmp_path / maker.file], tmp_path / "log", None, None)
    assert time.process_time() - start < makers.LIMIT
    log = read_log(tmp_path / "log")
    assert set(maker.streams) <= set(log)
    for name in maker.streams:
        series, true = log[name], getattr(motion, name)
        stamps = motion.time
        if len(series) < len(stamps):  # a file that lost rows
            kept = np.isin(np.round(makers.RATE * stamps), np.round(makers.RATE * series.time))
            stamps, true = stamps[kept], true[kept]
        np.testing.assert_allclose(series.time - series.time[0], stamps - stamps[0], atol=2e-6)
        if name == "attitude":
            true = true * np.sign(np.sum(true * series.value, axis=1))[:, None]
        np.testing.assert_allclose(series.value, true, atol=maker.digits, err_msg=name)


@pytest.mark.parametrize("maker", REFUSED, ids=lambda maker: maker.name)
def test_what_nobody_can_know_is_refused_with_the_reason(maker, motion, tmp_path: Path):
    maker.write(tmp_path / maker.file, motion)
    with pytest.raises(LogError) as error:
        import_files([tmp_path / maker.file], tmp_path / "log", None, None)
    assert maker.refused in str(error.value)
    assert "; " in str(error.value), "it says not what would do"
    assert not (tmp_path / "log").exists()


def test_a_folder_of_files_and_one_that_is_the_logs_are_taken_too(motion, tmp_path: Path):
    (tmp_path / "files").mkdir()
    makers.MAKERS[0].write(tmp_path / "files" / "imu.csv", motion)
    import_files([tmp_path / "files"], tmp_path / "log", None, None)
    import_files([tmp_path / "files" / "imu.csv"], tmp_path / "files", None, None)
    first, second = read_log(tmp_path / "log"), read_log(tmp_path / "files")
    np.testing.assert_array_equal(first["gyro"].value, second["gyro"].value)
    assert (tmp_path / "log" / "imu.csv").exists()


def test_a_unit_that_no_name_states_is_found_by_physics(motion, tmp_path: Path):
    gyro = np.degrees(motion.gyro)
    table = np.column_stack([motion.time, motion.attitude, gyro, motion.accelerometer])
    names = "t,qw,qx,qy,qz,gx,gy,gz,ax,ay,az"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=names, comments="", fmt="%.9f")
    done = import_files([tmp_path / "a.csv"], tmp_path / "log", None, None)
    np.testing.assert_allclose(done.recording["gyro"].value, motion.gyro, atol=1e-6)
    assert done.advice.findings == ()


def test_a_version_above_a_table_is_no_rate(motion, tmp_path: Path):
    table = np.column_stack([motion.time, motion.gyro])
    head = "1.2.3\nframe rate 1.2.3\nt,gyro_x,gyro_y,gyro_z"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=head, comments="", fmt="%.9f")
    done = import_files([tmp_path / "a.csv"], tmp_path / "log", None, None)
    np.testing.assert_allclose(done.recording["gyro"].time, motion.time, atol=1e-9)


@pytest.mark.parametrize("ending", ["csv", "mat"])
def test_a_body_that_the_cameras_see_late_has_its_attitude(motion, ending, tmp_path: Path):
    """Five thousand rows without one, more than are looked at of a file that has all."""
    blank = np.full((5000, 4), np.nan)
    time = np.arange(len(blank) + len(motion.time)) / makers.RATE
    rate = np.concatenate([np.zeros((len(blank), 3)), motion.gyro])
    attitude = np.concatenate([blank, motion.attitude])
    path = tmp_path / f"a.{ending}"
    if ending == "mat":
        from scipy.io import savemat

        savemat(path, {"t": time, "gyro": rate, "quat": attitude})
    else:
        table = np.column_stack([time, rate, attitude])
        names = "t,gyro_x,gyro_y,gyro_z,qw,qx,qy,qz"
        np.savetxt(path, table, "%.9f", delimiter=",", header=names, comments="")
    log = import_files([path], tmp_path / "log", None, None).recording
    assert len(log["attitude"]) == len(motion.time)
    np.testing.assert_allclose(np.abs(log["attitude"].value), np.abs(motion.attitude), atol=1e-8)


def test_columns_that_are_in_no_stream_are_said(motion, tmp_path: Path):
    table = np.column_stack([motion.time, motion.gyro, motion.time % 3.0, motion.time % 5.0])
    names = "t,gyro_x,gyro_y,gyro_z,valve,lamp"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=names, comments="")
    done = import_files([tmp_path / "a.csv"], tmp_path / "log", None, None)
    assert done.unread == ("a.csv: in no stream: valve, lamp",)


def test_an_angle_and_a_rate_alone_ask_for_the_machine_on_its_hinge(motion, tmp_path: Path):
    table = np.column_stack([motion.time, motion.euler[:, 0], motion.gyro[:, 0]])
    names = "time,position,velocity"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=names, comments="")
    with pytest.raises(LogError, match="--platform tells which are its angle, rate and torque"):
        import_files([tmp_path / "a.csv"], tmp_path / "log", None, None)


def test_rates_that_are_called_after_the_angles_are_the_gyros(motion, tmp_path: Path):
    table = np.column_stack([motion.time, np.degrees(motion.euler), np.degrees(motion.gyro)])
    names = "t,yaw [deg],pitch [deg],roll [deg],rollRate,pitchRate,yawRate"
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header=names, comments="", fmt="%.9f")
    done = import_files([tmp_path / "a.csv"], tmp_path / "log", None, None)
    np.testing.assert_allclose(done.recording["gyro"].value, motion.gyro, atol=1e-6)


@pytest.mark.parametrize(("log", "machine"), makers.REAL)
def test_a_real_file_is_read_as_its_shipped_log_states_it(log, machine, tmp_path: Path):
    shipped = read_log(makers.MODELS / log)
    files = [makers.MODELS / log / name for name in makers.files_of(makers.MODELS / log)]
    platform = None if machine is None else load_platform(machine)
    import_files(files, tmp_path / "log", platform, machine)
    found = read_log(tmp_path / "log")
    assert set(shipped) <= set(found)
    for name, series in shipped.items():
        np.testing.assert_allclose(found[name].time, series.time, atol=1e-9)
        np.testing.assert_allclose(found[name].value, series.value, atol=1e-12)
