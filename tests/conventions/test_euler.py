"""Euler angles are searched in their own signs and order, and the gyro is not blamed for them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.conventions.flights import flights, misread
from tests.seeds import seed_of
from twin.conventions import check_conventions, convention_advice, corrected
from twin.conventions.advice import corrected_lines
from twin.conventions.correction import (
    Correction,
    angle_changes,
    angles_of,
    attitude_changes,
    attitude_of,
    frames_of,
)
from twin.platform import Platform, load_platform
from twin.recording import Recording, Series, read_log

CLOCKWISE = "the attitude's yaw, pitch and roll turn clockwise, read as counterclockwise"
SIGNS = {
    (-1.0, 1.0, 1.0): "the attitude's yaw has the wrong sign",
    (1.0, -1.0, 1.0): "the attitude's pitch has the wrong sign",
    (1.0, 1.0, -1.0): "the attitude's roll has the wrong sign",
    (-1.0, -1.0, 1.0): "the attitude's yaw and pitch have the wrong signs",
    (-1.0, -1.0, -1.0): CLOCKWISE,
}
ORDERS = {
    (2, 1, 0): "the attitude's yaw and roll are swapped",
    (0, 2, 1): "the attitude's pitch and roll are swapped",
    (1, 2, 0): "the attitude's angles stand in another order",
}


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


@pytest.fixture(scope="module")
def drawn(request: pytest.FixtureRequest) -> np.random.Generator:
    seed = seed_of(request)
    return np.random.default_rng(seed)


@pytest.fixture(scope="module")
def right_logs(sads, drawn) -> list[Recording]:
    """Flights whose attitude a file gives as yaw, pitch and roll: of all headings, and of small
    angles."""
    cells = [("fine", "hanging"), ("middle", "multisine")]
    logs = [log for cell in cells for log in flights(sads, drawn, *cell, 1)]
    return [in_angles(log) for log in logs]


def in_angles(log: Recording) -> Recording:
    stated = {"format": "euler_zyx", "columns": ["yaw", "pitch", "roll"]}
    provenance = {**log.provenance, "kind": "log", "streams": {"attitude": stated}}
    return replace(log, provenance=provenance)


def with_angles(log: Recording, signs: tuple[float, ...], order: tuple[int, ...]) -> Recording:
    """The log whose file has other angles than its format says."""
    angles = angles_of(log["attitude"].value, "ZYX", world_to_body=False)
    wrong = (angles * np.array(signs))[:, list(order)]
    value = attitude_of(wrong, "ZYX", world_to_body=False)
    return misread(log, "attitude", value=value)


def readings(log: Recording, platform: Platform) -> list[str]:
    """All that is wrong with the log, in one way or another."""
    findings = check_conventions(log, platform)
    others = dict.fromkeys(text for finding in findings for text in finding.alternatives)
    return [", and ".join(finding.correction.words for finding in findings), *others]


def test_right_angles_have_no_finding(sads, right_logs):
    assert [readings(log, sads) for log in right_logs] == [[""], [""]]


def test_angles_of_other_signs_are_named(sads, drawn, right_logs):
    for index in drawn.permutation(len(SIGNS))[:3]:
        signs = list(SIGNS)[index]
        said = readings(with_angles(right_logs[0], signs, (0, 1, 2)), sads)
        assert said == [SIGNS[signs]]


def test_small_clockwise_angles_are_not_blamed_on_the_gyro(sads, right_logs):
    """Where all angles are small, the inverse is nearly the same: both are given, then."""
    said = readings(with_angles(right_logs[1], (-1.0, -1.0, -1.0), (0, 1, 2)), sads)
    assert any(CLOCKWISE in reading for reading in said), said
    assert not any("gyro" in reading for reading in said), said


def test_angles_in_another_order_are_named(sads, drawn, right_logs):
    order = list(ORDERS)[drawn.integers(len(ORDERS))]
    (said,) = readings(with_angles(right_logs[0], (1.0, 1.0, 1.0), order), sads)
    assert said.startswith(ORDERS[order])


def test_clockwise_angles_are_written_with_minus_signs(sads, right_logs):
    wrong = with_angles(right_logs[0], (-1.0, -1.0, -1.0), (0, 1, 2))
    advice = convention_advice(wrong, sads)
    assert advice.log_toml == '[streams.attitude]\ncolumns = ["-yaw", "-pitch", "-roll"]'
    mended = corrected(wrong, list(advice.findings))
    turned = np.sum(mended["attitude"].value * right_logs[0]["attitude"].value, axis=1)
    np.testing.assert_allclose(np.abs(turned), 1.0, atol=1e-12)
    assert check_conventions(mended, sads) == []


def attitude_log(folder: Path, keys: str, values: NDArray[np.float64]) -> Recording:
    """A log of an attitude alone, in columns of any names."""
    names = ",".join(f"c{i}" for i in range(values.shape[1]))
    rows = "".join(f"{i},{','.join(map(repr, row.tolist()))}\n" for i, row in enumerate(values))
    (folder / "a.csv").write_text(f"t,{names}\n{rows}")
    (folder / "log.toml").write_text(f'[streams.attitude]\nfile = "a.csv"\n{keys}')
    return read_log(folder)


def written(folder: Path, log: Recording, change: Correction) -> NDArray[np.float64]:
    """The attitude read again with the lines that are offered for a correction."""
    text = (folder / "log.toml").read_text()
    lines = corrected_lines(log, [change])[1:]
    kept = [row for row in text.splitlines() if row.split(" =")[0] not in "\n".join(lines)]
    (folder / "log.toml").write_text("\n".join([*kept, *lines]))
    value = read_log(folder)["attitude"].value
    (folder / "log.toml").write_text(text)
    return value


@pytest.mark.parametrize("layout", ["euler_zyx", "euler_xyz", "euler_zxy"])
@pytest.mark.parametrize("direction", ["body_to_world", "world_to_body"])
def test_every_reading_of_angles_can_be_written(tmp_path: Path, layout: str, direction: str):
    angles = np.random.default_rng(2).uniform(-1.0, 1.0, (20, 3))
    keys = f'format = "{layout}"\ndirection = "{direction}"\n'
    log = attitude_log(tmp_path, keys, angles)
    changes = [*angle_changes(log), *frames_of(log)[1].corrections]
    assert len(changes) == 48
    for change in changes:
        wanted = np.sum(change.apply(log["attitude"]).value * written(tmp_path, log, change), 1)
        np.testing.assert_allclose(np.abs(wanted), 1.0, err_msg=change.words)


@pytest.mark.parametrize("layout", ["rotation_vector", "matrix"])
def test_every_reading_of_vectors_and_matrices_can_be_written(tmp_path: Path, layout: str):
    values = np.random.default_rng(3).uniform(-1.0, 1.0, (20, 3))
    if layout == "matrix":
        values = Rotation.from_rotvec(values).as_matrix().reshape(-1, 9)
    log = attitude_log(tmp_path, f'format = "{layout}"\n', values)
    changes = [change for _, change in attitude_changes(log) if change is not None]
    changes += frames_of(log)[1].corrections
    assert len(changes) == 48
    for change in changes:
        wanted = np.sum(change.apply(log["attitude"]).value * written(tmp_path, log, change), 1)
        np.testing.assert_allclose(np.abs(wanted), 1.0, err_msg=change.words)


@pytest.mark.parametrize("sequence", ["ZYX", "XYZ", "ZXY", "ZYZ"])
def test_a_wrong_order_is_undone_where_its_middle_angle_is_beyond_a_right_angle(sequence: str):
    draw = np.random.default_rng(4)
    turned = Rotation.random(200, random_state=draw).as_quat(scalar_first=True)
    angles = angles_of(turned, sequence, world_to_body=False)
    log = Recording(
        {"attitude": Series(np.arange(200.0), turned, ("w", "x", "y", "z"), "1")},
        {"streams": {"attitude": {"format": f"euler_{sequence.lower()}"}}},
    )
    for change in angle_changes(log):
        wrong = angles @ np.array(change.axes)
        series = replace(log["attitude"], value=attitude_of(wrong, sequence, world_to_body=False))
        right = change.apply(series).value
        np.testing.assert_allclose(np.abs(np.sum(right * turned, axis=1)), 1.0, atol=1e-9)
