"""The base is found, its intervals are honest, and what cannot be told is said."""

from dataclasses import replace

import numpy as np
import pytest

from twin.errors import UnknownName, UsageError
from twin.identification import identify
from twin.library import library
from twin.platform import load_platform
from twin.recording import Recording, open_log


@pytest.fixture(scope="module")
def found(campaign):
    return identify(campaign.logs[:1], campaign.stated)


def test_prediction_error_finds_the_base_within_its_intervals(campaign, found):
    sigma = found.half_widths / found.quantile
    assert np.all(np.abs(found.theta - campaign.truth) < 4.0 * sigma)
    assert sigma[:3].max() < 0.02 * 12.0
    assert found.fit.converged


def test_what_is_left_of_a_true_model_is_noise(found):
    # the band holds two standard deviations; here four
    assert all(abs(part.chi2_per_sample - 1.0) < part.high - part.low for part in found.misfit)


def test_two_logs_together_know_more_than_one(campaign, found):
    both = identify(campaign.logs, campaign.stated)
    assert np.all(both.half_widths < found.half_widths)
    sigma = both.half_widths / both.quantile
    assert np.all(np.abs(both.theta - campaign.truth) < 4.0 * sigma)


def test_the_fit_does_not_depend_on_where_it_starts(campaign, found):
    elsewhere = replace(campaign.stated, inertia=1.2 * campaign.stated.inertia)
    again = identify(campaign.logs[:1], elsewhere)
    assert np.all(np.abs(again.theta - found.theta) < 0.1 * found.half_widths)


def test_momentum_lands_within_three_percent(campaign):
    found = identify(campaign.logs[:1], campaign.stated, "momentum")
    size = np.array([12.0] * 6 + [0.05] * 3)
    assert np.all(np.abs(found.theta - campaign.truth) < 0.03 * size)
    assert found.document()["method"] == "momentum"


def test_wheels_that_no_command_drives_are_states(campaign):
    """Their measured speed tells their momentum; the torque on them is nobody's business."""
    log = campaign.logs[0]
    told = {n: s for n, s in log.items() if not n.startswith(("command_wheel", "wanted_wheel"))}
    found = identify([Recording(told, log.provenance)], campaign.stated)
    assert found.fit.converged
    assert found.misfit[0].is_noise
    assert found.disturbance == 0.0
    sigma = found.half_widths / found.quantile
    assert np.all(np.abs(found.theta - campaign.truth) < 4.0 * sigma)
    assert sigma[:3].max() < 0.05 * 12.0


def test_a_machine_at_rest_tells_nothing_of_its_inertia(campaign):
    log = campaign.logs[0]
    rng = np.random.default_rng(3)
    streams = dict(log.streams)
    for name, noise in (("gyro", 1e-3), ("wheel_speed", 0.1)):
        series = streams[name]
        streams[name] = replace(series, value=rng.normal(0.0, noise, series.value.shape))
    attitude = streams["attitude"]
    level = np.column_stack([np.ones(len(attitude)), rng.normal(0.0, 5e-4, (len(attitude), 3))])
    streams["attitude"] = replace(attitude, value=level / np.linalg.norm(level, axis=1)[:, None])
    command = streams["command_wheel_torque"]
    streams["command_wheel_torque"] = replace(command, value=np.zeros_like(command.value))
    found = identify([Recording(streams, log.provenance)], campaign.stated)
    assert "yaw inertia Jzz: not excited" in found.not_excited


def test_the_scale_that_wheels_leave_open_is_always_said(found):
    assert any("one common scale" in sentence for sentence in found.not_excited)


def test_a_moved_mass_sets_the_scale(campaign):
    log = campaign.logs[0]
    stage = log["stage_position"]
    moved = stage.value + 0.01 * (stage.time > 30.0)[:, None]
    streams = {**log.streams, "stage_position": replace(stage, value=moved)}
    found = identify([Recording(streams, log.provenance)], campaign.stated, "momentum")
    assert not any("one common scale" in sentence for sentence in found.not_excited)


def test_a_method_nobody_knows_is_named(campaign):
    with pytest.raises(UnknownName, match="prediction-error"):
        identify(campaign.logs, campaign.stated, "guess")


def test_no_log_is_wrong_use():
    with pytest.raises(UsageError, match="no log"):
        identify([], load_platform("sads"))


def test_a_model_that_misses_by_far_is_still_answered_with_a_wide_interval():
    log = open_log(library("models") / "dfki_pendulum" / "logs" / "energy_shaping")
    found = identify([log.between(0.0, 8.0)], load_platform("dfki_pendulum"))
    assert found.fit.converged
    assert not found.misfit[0].is_noise
    assert found.disturbance > 0.0
    # README.md of the model: friction added, 0.189 kg m2 and 0.375 kg m
    assert abs(found.theta[0] - 0.189) < found.half_widths[0]
    assert abs(found.theta[2] + 0.375) < found.half_widths[2]
