"""The papers' methods: right where nothing is noisy, wrong where the papers say so."""

import json
from typing import get_args

import numpy as np
import pytest

from twin.cli.fits import Method
from twin.cli.main import main
from twin.errors import UsageError
from twin.identification import METHODS, Settings, identify
from twin.identification.linear import STEP, integrated, least_squares, recursive
from twin.identification.methods import Logs
from twin.identification.start import base_of
from twin.model import compile_model
from twin.platform import load_platform
from twin.recording import Recording, Series
from twin.rotation import from_rotation_vector, multiply

SEED = 20261122
SIZE = np.array([12.0] * 6 + [0.05] * 3)
"""Of the errors that follow, parameter by parameter."""
HALF = 30.0
"""Of the quiet log [s]: as much as the costly methods need."""
COSTLY = ("prediction-error", "levenberg-marquardt", "ekf", "ukf")


@pytest.fixture(scope="module")
def quiet(flown):
    """A log in which next to nothing is noise."""
    return flown(1, SEED, 60.0, gyro=1e-6, attitude=1e-6, wheel_speed=1e-5)


def worst(found, campaign) -> float:
    """Largest error, in parts of a typical size."""
    return float(np.abs((found.theta - campaign.truth) / SIZE).max())


@pytest.mark.parametrize(
    ("method", "within"),
    [
        ("prediction-error", 1e-4),
        ("levenberg-marquardt", 1e-4),
        ("momentum", 1e-3),
        ("ekf", 2e-3),
        ("ukf", 2e-3),
        ("torque", 2e-3),
        ("integrated", 2e-3),
        ("energy", 2e-3),
        ("filtered", 2e-3),
        ("recursive", 1e-2),
    ],
)
def test_without_noise_every_method_finds_the_base(quiet, method, within):
    print(f"seed {SEED}")
    logs = [log.between(0.0, HALF) for log in quiet.logs] if method in COSTLY else quiet.logs
    assert worst(identify(logs, quiet.stated, method), quiet) < within


@pytest.mark.parametrize("shift", [1, 2, 3])
def test_without_noise_differences_of_the_balance_find_it_too(quiet, shift):
    # wheel speeds come every 50 ms: between samples of 10 ms they are interpolated past their kinks
    found = identify(quiet.logs, quiet.stated, "momentum", Settings(shift=shift))
    assert worst(found, quiet) < 0.1 / shift


def test_differentiated_rates_ruin_what_integrated_ones_still_tell(campaign):
    """AAS 04-122, Fig. 2: the natural form wants a gyro ten times as good."""
    forms = [
        worst(identify(campaign.logs[:1], campaign.stated, "torque", Settings(form=form)), campaign)
        for form in ("integrated", "natural")
    ]
    assert forms[1] > 3.0 * forms[0]


def test_a_recursion_that_forgets_nothing_is_least_squares(quiet):
    base, _ = base_of(compile_model(quiet.stated), quiet.logs)
    tracks = Logs(quiet.logs, base).tracks
    rows = [integrated(t).every(max(round(STEP / t.step), 1)) for t in tracks]
    batch, sequence = least_squares(rows, base), recursive(tracks, base, forgetting=1.0)
    np.testing.assert_allclose(sequence.theta / SIZE, batch.theta / SIZE, atol=1e-4)


def test_one_trajectory_tells_as_much_as_all_innovations_where_nothing_disturbs(campaign):
    one, best = (
        identify(campaign.logs[:1], campaign.stated, method)
        for method in ("levenberg-marquardt", "prediction-error")
    )
    assert np.all(np.abs(one.theta - best.theta) < 0.3 * best.half_widths)
    np.testing.assert_allclose(one.half_widths, best.half_widths, rtol=0.3)


def rests(seed: int) -> tuple[Recording, np.ndarray]:
    """A sads that hangs still under its CM with its masses in four places, and its true m r."""
    rng = np.random.default_rng(seed)
    sads = load_platform("sads")
    moment = np.array([0.02, -0.03, -0.4]) * rng.uniform(0.5, 1.5, 3)
    places = np.array([[0.0, 0.0, 0.0], [0.03, 0.0, 0.0], [0.0, 0.04, 0.0], [0.0, 0.0, 0.05]])
    time = np.arange(0.0, 120.0, 0.05)
    which = np.minimum((time / 30.0).astype(int), 3)
    masses = np.array([stage.mass for stage in sads.stages])
    axes = np.array([stage.axis for stage in sads.stages])
    attitude = np.empty((len(time), 4))
    for place, d in enumerate(places):
        up = -(moment + (masses * d) @ axes)
        up = up / np.linalg.norm(up)
        turn = np.cross([0.0, 0.0, 1.0], up)
        # the body's axes, so that its own up becomes the world's
        tilt = from_rotation_vector(-turn / np.linalg.norm(turn) * np.arccos(up[2]))
        attitude[which == place] = tilt
    noise = from_rotation_vector(1e-3 * rng.normal(size=(len(time), 3)))
    streams = {
        "attitude": Series(time, multiply(attitude, noise), ("w", "x", "y", "z"), "1"),
        "gyro": Series(time, 1e-3 * rng.normal(size=(len(time), 3)), ("x", "y", "z"), "rad/s"),
        "wheel_speed": Series(time, np.zeros((len(time), 3)), ("w1", "w2", "w3"), "rad/s"),
        "stage_position": Series(time, places[which], ("s1", "s2", "s3"), "m"),
    }
    return Recording(streams, {"platform": "sads"}), moment


def test_rests_at_several_places_of_the_masses_tell_m_r_and_not_j():
    covered = 0
    for seed in range(SEED, SEED + 5):
        log, moment = rests(seed)
        found = identify([log], load_platform("sads"), "equilibria")
        off = np.abs(found.theta[6:] - moment)
        assert np.all(off < 0.02 * np.linalg.norm(moment)), seed
        covered += int(np.sum(off < found.half_widths[6:]))
        assert any("roll inertia" in sentence for sentence in found.not_excited)
    assert covered >= 12


def test_masses_that_stay_where_they_are_are_no_equilibria(campaign):
    with pytest.raises(UsageError, match="stand still for"):
        identify(campaign.logs[:1], campaign.stated, "equilibria")


def test_a_filter_of_a_ball_is_not_run_on_a_hinge(pendulum, swing):
    with pytest.raises(UsageError, match="turns about a hinge"):
        identify([swing()], pendulum, "ekf")


@pytest.mark.parametrize(
    ("settings", "said"),
    [({"shift": -1}, "samples"), ({"corner": 0.0}, "above 0"), ({"forgetting": 1.5}, "at most 1")],
)
def test_settings_that_mean_nothing_are_refused(settings, said):
    with pytest.raises(UsageError, match=said):
        Settings(**settings)


def test_the_command_line_has_every_method():
    assert get_args(Method) == (*METHODS, "all")


def test_all_methods_stand_in_one_table(tmp_path, capsys):
    run = ["run", "sads", "--controller", "quaternion_pd", "--duration", "5", "--seed", "3"]
    assert main([*run, "--rrd", str(tmp_path / "run.rrd")]) == 0
    capsys.readouterr()
    assert main(["identify", str(tmp_path / "run.rrd"), "--method", "all"]) == 0
    table = capsys.readouterr().out
    for method in METHODS:
        assert f"\n{method}" in table
    assert "momentum, natural, shift 3" in table
    assert "equilibria: the sliding masses stand still" in table
    assert main(["identify", str(tmp_path / "run.rrd"), "--method", "all", "--json"]) == 0
    documents = json.loads(capsys.readouterr().out)
    assert {one["method"].partition(",")[0].partition(" ")[0] for one in documents} == set(METHODS)
    assert [one["method"] for one in documents if "failed" in one] == ["equilibria"]
