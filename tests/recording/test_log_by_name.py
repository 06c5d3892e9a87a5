"""Columns that are named as the stream's or the machine's are, in another order, go by name."""

from pathlib import Path

import numpy as np
import pytest

from twin import rotation
from twin.conventions.advice import corrected_lines
from twin.conventions.correction import Correction, as_tuple
from twin.errors import LogError
from twin.platform import in_order_of, load_platform
from twin.recording import read_log, write_folder

ATTITUDE = '[streams.attitude]\nfile = "a.csv"\n'
WHEELS = '[streams.wheel_speed]\nfile = "w.csv"\n'


def table(names: str, values: np.ndarray) -> str:
    rows = "".join(f"{i},{','.join(map(repr, row.tolist()))}\n" for i, row in enumerate(values))
    return f"t,{names}\n{rows}"


@pytest.mark.parametrize("names", ["roll,pitch,yaw", "pitch,yaw,roll", "Roll,Pitch,Yaw"])
def test_euler_angles_in_any_order_are_the_same_attitude(folder_with, tmp_path: Path, names: str):
    angles = {"yaw": 0.3, "pitch": -0.2, "roll": 0.1}
    row = np.array([[angles[name.lower()] for name in names.split(",")]] * 2)
    toml = ATTITUDE + 'format = "euler_zyx"\n'
    log = read_log(folder_with(tmp_path, toml, a=table(names, row)))
    np.testing.assert_allclose(log["attitude"].value[0], rotation.from_euler_zyx(0.3, -0.2, 0.1))
    assert f"columns {names.replace(',', ', ')} taken by name, as " in log.repairs[0]


def test_a_scalar_named_last_is_the_scalar(folder_with, tmp_path: Path):
    row = np.array([[0.1, 0.2, 0.3, np.sqrt(1.0 - 0.14)]] * 2)
    log = read_log(folder_with(tmp_path, ATTITUDE, a=table("x,y,z,w", row)))
    np.testing.assert_allclose(log["attitude"].value[0], row[0, [3, 0, 1, 2]])


def test_a_stated_format_that_the_names_deny_is_refused(folder_with, tmp_path: Path, complaint):
    row = np.array([[0.1, 0.2, 0.3, np.sqrt(1.0 - 0.14)]] * 2)
    toml = ATTITUDE + 'format = "wxyz"\n'
    assert complaint(folder_with(tmp_path, toml, a=table("x,y,z,w", row))) == (
        "log.toml:4: streams.attitude.format is 'wxyz', but the columns are named x, y, z, w; "
        "remove `format`, and they are taken by name; if the names are wrong, list them as "
        '`columns = ["x", "y", "z", "w"]`'
    )


def test_listed_columns_are_in_order_whatever_their_names(folder_with, tmp_path: Path):
    toml = '[streams.gyro]\nfile = "g.csv"\ncolumns = ["z", "x", "y"]\n'
    log = read_log(folder_with(tmp_path, toml, g=table("x,y,z", np.array([[1.0, 2.0, 3.0]]))))
    np.testing.assert_array_equal(log["gyro"].value, [[3.0, 1.0, 2.0]])
    assert log.repairs == ()


def test_noise_goes_with_its_column(folder_with, tmp_path: Path):
    toml = '[streams.gyro]\nfile = "g.csv"\nnoise = [3.0, 1.0, 2.0]\n'
    log = read_log(folder_with(tmp_path, toml, g=table("z,x,y", np.array([[3.0, 1.0, 2.0]]))))
    np.testing.assert_array_equal(log["gyro"].value, [[1.0, 2.0, 3.0]])
    assert log.provenance["streams"]["gyro"]["noise"] == [1.0, 2.0, 3.0]


@pytest.fixture
def wheels() -> tuple[str, ...]:
    return load_platform("sads").columns("wheel_speed")


def test_wheels_named_in_another_order_are_the_machines_own(folder_with, tmp_path: Path, wheels):
    platform, names = load_platform("sads"), [wheels[1], wheels[0], *wheels[2:]]
    row = np.array([[float(wheels.index(name)) for name in names]])
    log = in_order_of(
        platform, read_log(folder_with(tmp_path, WHEELS, w=table(",".join(names), row)))
    )
    np.testing.assert_array_equal(log["wheel_speed"].value, [np.arange(len(wheels))])
    assert log["wheel_speed"].columns == wheels
    assert log.provenance["streams"]["wheel_speed"]["columns"] == list(wheels)
    assert len(log.repairs) == 1
    assert in_order_of(platform, log) is log


@pytest.mark.parametrize("format", ["csv", "parquet", "mat"])
def test_wheels_that_are_listed_in_order_stay_so_when_exported(
    folder_with, tmp_path: Path, wheels, format: str
):
    names = [wheels[1], wheels[0], *wheels[2:]]
    row = np.tile(np.arange(len(names), dtype=float), (3, 1))
    toml = WHEELS + f"columns = {names}\n".replace("'", '"')
    log = read_log(folder_with(tmp_path, toml, w=table(",".join(names), row)))
    write_folder(log, tmp_path / "again", format=format)
    for one in (log, read_log(tmp_path / "again")):
        ordered = in_order_of(load_platform("sads"), one)
        np.testing.assert_array_equal(ordered["wheel_speed"].value, row)


def test_euler_angles_that_were_exchanged_are_mended_by_columns(folder_with, tmp_path: Path):
    row = np.array([[0.01, 0.02, 0.03]] * 2)
    toml = ATTITUDE + 'format = "euler_zyx"\n'
    log = read_log(folder_with(tmp_path, toml, a=table("a,b,c", row)))
    exchanged = np.eye(3)[[2, 1, 0]]
    wrong = Correction("attitude", "angles", "angles exchanged", axes=as_tuple(exchanged))
    lines = corrected_lines(log, [wrong])
    assert lines == ["[streams.attitude]", 'columns = ["c", "b", "a"]']


def test_degrees_that_pass_for_radians_are_told_by_a_pitch_that_cannot_be(
    folder_with, tmp_path: Path
):
    row = np.array([[0.1, 0.2, 0.3], [20.0, 4.5, 1.0]])
    toml = ATTITUDE + 'format = "euler_zyx"\n'
    folder = folder_with(tmp_path, toml, a=table("yaw,pitch,roll", row))
    with pytest.raises(LogError, match=r"a\.csv:3: .* pitch of 4\.5 rad.*say unit = \"deg\""):
        read_log(folder)
    (folder / "log.toml").write_text((folder / "log.toml").read_text() + 'unit = "deg"\n')
    assert len(read_log(folder)["attitude"]) == 2


def test_a_scalar_that_is_named_wrongly_is_mended_by_columns(folder_with, tmp_path: Path):
    row = np.array([[0.1, 0.2, 0.3, np.sqrt(1.0 - 0.14)]] * 2)
    log = read_log(folder_with(tmp_path, ATTITUDE, a=table("w,x,y,z", row)))
    wrong = Correction("attitude", "order", "the scalar stands last", (("format", "xyzw"),))
    lines = corrected_lines(log, [wrong])
    toml = "\n".join([lines[0], 'file = "a.csv"', *lines[1:], ""])
    again = read_log(folder_with(tmp_path, toml, a=table("w,x,y,z", row)))
    np.testing.assert_allclose(again["attitude"].value[0], row[0, [3, 0, 1, 2]])


@pytest.mark.parametrize(
    "names",
    ["gyro_z,gyro_y,gyro_x", "z [rad/s],y [rad/s],x [rad/s]", "Z_gyr,Y_gyr,X_gyr", "wz,wy,wx"],
)
def test_what_all_names_share_says_nothing_of_the_order(folder_with, tmp_path: Path, names: str):
    toml = '[streams.gyro]\nfile = "g.csv"\n'
    log = read_log(folder_with(tmp_path, toml, g=table(names, np.array([[3.0, 2.0, 1.0]] * 2))))
    np.testing.assert_array_equal(log["gyro"].value[0], [1.0, 2.0, 3.0])
    assert "taken by name" in log.repairs[0]


def test_quaternions_with_a_letter_before_their_parts_are_taken_by_name(
    folder_with, tmp_path: Path
):
    row = np.array([[0.0, 0.0, 0.6, 0.8]] * 2)
    log = read_log(folder_with(tmp_path, ATTITUDE, a=table("qx,qy,qz,qw", row)))
    np.testing.assert_allclose(log["attitude"].value[0], [0.8, 0.0, 0.0, 0.6])


def test_wheels_with_a_unit_behind_their_names_are_the_machines(folder_with, tmp_path: Path):
    toml = WHEELS + 'unit = "rpm"\n'
    names, row = "w3 [rpm],w1 [rpm],w2 [rpm]", np.array([[3.0, 1.0, 2.0]] * 2)
    log = read_log(folder_with(tmp_path, toml, w=table(names, row)))
    speed = in_order_of(load_platform("sads"), log)["wheel_speed"]
    assert speed.columns == ("w1", "w2", "w3")
    np.testing.assert_allclose(speed.value[0] * 30.0 / np.pi, [1.0, 2.0, 3.0])
