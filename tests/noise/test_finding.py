"""A stated noise that the data contradict is said, with both numbers."""

import dataclasses

import numpy as np
import pytest

from twin.noise import noise_findings
from twin.platform import Sensor, load_platform
from twin.recording import Recording, Series


@pytest.fixture(scope="module")
def log(flown) -> Recording:
    """As platform.toml states it."""
    return flown({"gyro": 1e-3, "attitude": 1e-3, "wheel_speed": 0.1}, {})


def claiming(sads, **noise: float):
    sensors: dict[str, Sensor] = dict(sads.sensors)
    for name, sigma in noise.items():
        sensors[name] = dataclasses.replace(sensors[name], noise=np.full(3, sigma))
    return dataclasses.replace(sads, sensors=sensors)


def test_a_right_claim_is_no_finding(log, sads):
    assert noise_findings(log, sads) == []
    assert noise_findings(log, None) == []


@pytest.mark.parametrize(("stated", "said"), [(1.4e-3, 0), (0.7e-3, 0), (1.7e-3, 1), (0.6e-3, 1)])
def test_a_claim_off_by_more_than_a_factor_of_one_and_a_half_is_said(log, sads, stated, said):
    found = noise_findings(log, claiming(sads, gyro=stated))
    assert [(f.stream, f.kind, f.stated) for f in found] == [("gyro", "noise", stated)] * said


def test_the_sentence_names_both_numbers_and_who_stated_it(log, sads):
    (found,) = noise_findings(log, claiming(sads, attitude=3.5e-2))
    assert found.sentence.startswith("The noise of attitude is 0.05")
    assert found.sentence.endswith("times less than the 2.01 deg that platform.toml states.")


@pytest.mark.parametrize(
    ("platform", "law", "reference"),
    [
        ("sads", "mass_pid", None),
        ("astros", "mass_pid", "multisine:3"),
        ("astros:mode_b", "vscmg_pd", "multisine:3"),
        ("cubesat", "mass_magnetic_pid", None),
    ],
)
def test_what_is_told_to_move_or_shaken_as_stated_is_no_noise(flight_of, platform, law, reference):
    log = flight_of(platform, law, reference, 20.0, 7)
    found = noise_findings(log, load_platform(platform))
    assert [one.sentence for one in found if one.kind in ("noise", "outliers", "repeated")] == []


def test_what_the_log_states_stands_before_the_platform(log, sads):
    provenance = {"streams": {"gyro": {"noise": [1e-2]}}}
    stated = dataclasses.replace(log, provenance=provenance)
    (found,) = noise_findings(stated, sads)
    assert (found.stream, found.stated) == ("gyro", 1e-2)
    assert "that the log states" in found.sentence


def test_gaps_jitter_outliers_grids_and_repeats_are_said(swing):
    draw = np.random.default_rng(5)
    good = swing(draw, 1e-3)

    def kinds(time, value) -> list[str]:
        streams = {"gyro": Series(time, value, good.columns, good.unit)}
        found = noise_findings(Recording(streams), None)
        assert all(f.sentence.endswith(".") and "gyro" in f.sentence for f in found)
        return [f.kind for f in found]

    spiked = good.value.copy()
    spiked[50:5950:100] += 0.3
    kept = np.r_[0:2000, 2100:6000]
    shaken = good.time + 2e-3 * draw.uniform(-1.0, 1.0, 6000)
    assert kinds(good.time, good.value) == []
    assert kinds(good.time, spiked) == ["outliers"]
    assert kinds(good.time[kept], good.value[kept]) == ["gaps"]
    assert kinds(shaken, good.value) == ["jitter"]
    assert kinds(good.time, np.round(good.value / 0.01) * 0.01) == ["quantised"]
    irregular = np.maximum.accumulate(np.where(draw.random(6000) < 0.5, np.arange(6000), 0))
    assert kinds(good.time, good.value[irregular]) == ["repeated"]
    # at a steady rate they are left out, and `cleaned` says so
    assert kinds(good.time, np.repeat(good.value[::5], 5, axis=0)) == []


def test_neither_commands_nor_truth_are_sensors(swing):
    draw = np.random.default_rng(5)
    good = swing(draw, 1e-3)
    kept = np.r_[0:2000, 2100:6000]
    gappy = Series(good.time[kept], good.value[kept], good.columns, good.unit)
    streams = {"truth_rate": gappy, "command_wheel_torque": gappy, "own": gappy}
    assert noise_findings(Recording(streams), None) == []


def test_values_whose_scale_is_to_be_fitted_are_called_by_their_own_unit(swing, sads):
    good = swing(np.random.default_rng(6), 1e-3)
    rough = np.round(good.value / 0.05) * 0.05
    streams = {"gyro": Series(good.time, rough, good.columns, good.unit)}
    entry = {"gyro": {"fit_scale": True, "unit": "mV"}}
    (found,) = noise_findings(Recording(streams, {"streams": entry}), sads)
    assert found.sentence.startswith("gyro comes in steps of 0.05 V, which is more than its noise")
