"""Balancings flown through the one loop."""

import json
from dataclasses import replace

import numpy as np
import pytest

from tests.seeds import seed_of
from twin.cli.main import main
from twin.clock import SimulatedClock
from twin.estimators import load_estimator
from twin.loop import fly
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.procedures import Phase, balancing, random_offsets, usual_target
from twin.recording import open_log
from twin.reference import Hold
from twin.signals import Estimate, Tick

CUBESAT = load_platform("cubesat")


class Last:
    """What was applied at the last tick."""

    applied: dict[str, np.ndarray]

    def collect(self, tick: Tick) -> None:
        self.applied = tick.applied


def flown(offsets: np.ndarray, runs: range, duration: float, target: float = 4.3e-5):
    procedure = balancing(CUBESAT, len(runs), way="direct", target=target, workers=0)
    start = InitialState(center_of_mass_offset=offsets)
    plant, last = SimulatedPlant(CUBESAT, runs=runs, seed=5, initial=start), Last()
    outcome = fly(
        plant,
        load_estimator("filter"),
        procedure,
        Hold(),
        SimulatedClock(),
        duration=duration,
        observers=[procedure.lab.logbook, last],
    )
    return procedure.lab.notes.runs, plant, outcome, last


def test_offset_found_to_be_beyond_reach_stops_the_run_and_leaves_it_safe():
    beyond = np.array([[1.0e-3, 0.0, -3e-4]])
    (notes,), plant, outcome, last = flown(beyond, range(1), 400.0)
    assert notes.phase is Phase.stopped, notes.said
    assert "beyond the masses' reach: s1 would have to stand at" in notes.reason
    assert outcome.duration < 400.0, "a run that is over needs no more ticks"
    assert not last.applied["command_dipole"].any()
    shown = plant.truth()["truth_stage_position"].value[0, 0]
    np.testing.assert_allclose(last.applied["command_stage_position"][0], shown, atol=1e-5)


def test_run_has_the_same_phases_alone_as_among_others():
    offsets = random_offsets(CUBESAT, 5, 2)
    together, *_ = flown(offsets, range(2), 60.0)
    alone, *_ = flown(offsets[1:], range(1, 2), 60.0)
    said = [remark[1:] for remark in together[1].said]
    assert len(said) > 1
    assert said == [remark[1:] for remark in alone[0].said]


def test_masses_stay_where_their_law_balances_the_body_and_not_where_noise_last_sent_them():
    procedure = balancing(CUBESAT, 1, way="masses", target=4.3e-5, workers=0)
    procedure = replace(procedure, level_for=80.0)
    phases, left = set[Phase](), list[np.ndarray]()

    class AfterTheLaw:
        """The offset while the body settles once its law is done."""

        def collect(self, tick: Tick) -> None:
            (notes,) = procedure.lab.notes.runs
            phases.add(notes.phase)
            if Phase.level in phases and notes.phase is Phase.settle:
                left.append(tick.truth["truth_center_of_mass_offset"].value[0, 0])

    start = InitialState(center_of_mass_offset=random_offsets(CUBESAT, 5, 2)[1:])
    fly(
        SimulatedPlant(CUBESAT, runs=[1], seed=5, initial=start),
        load_estimator("filter"),
        procedure,
        Hold(),
        SimulatedClock(),
        duration=160.0,
        observers=[procedure.lab.logbook, AfterTheLaw()],
    )
    print(f"{left[-1] * 1e6 / CUBESAT.mass} um")
    # what the gyro's noise asks of the masses at any instant is some micrometres
    assert np.abs(left[-1][:2]).max() < 1e-6 * CUBESAT.mass


def test_a_body_that_swings_slowly_is_seen_to_rest_though_its_gyro_is_noisy(
    request: pytest.FixtureRequest,
):
    platform, n = load_platform("whorl2"), 20
    noise = platform.sensors["gyro"].noise
    seed = seed_of(request)
    rng = np.random.default_rng(seed)
    procedure = balancing(platform, n, way="direct", target=usual_target(platform), workers=0)
    state = procedure.init(platform, n)
    place, still, seen = np.zeros((n, 3)), np.zeros((n, 3)), np.ones(n, dtype=bool)
    level = np.tile([1.0, 0.0, 0.0, 0.0], (n, 1))
    for tick in range(round(200.0 / platform.tick)):
        # 3 um below the centre of rotation
        state.stiffness[:] = platform.gravity * platform.mass * 3e-6
        rate = noise * rng.standard_normal((n, 3))
        none = np.zeros((n, 0))
        time = tick * platform.tick
        shown = Estimate(time, level, rate, still, place, none, none, still, seen)
        command, state = procedure.update(state, shown, Hold().at(np.full(n, time)), time)
        place = command["command_stage_position"]
        if np.all(state.phase > Phase.settle):
            break
    assert np.all((state.phase > Phase.settle) & (state.phase < Phase.stopped))


def test_command_line_refuses_before_it_starts_and_says_how_far(capsys):
    assert main(["balance", "astros"]) == 1
    told = capsys.readouterr().err
    assert "s3 would have to stand at 38" in told
    assert "lower:" not in told
    assert main(["balance", "cubesat", "--target", "-1"]) == 2
    assert main(["balance", "cubesat", "--plant", "replay:x.rrd"]) == 2
    assert "does not move" in capsys.readouterr().err


def test_what_time_runs_out_for_is_told_as_failed(capsys):
    assert main(["balance", "cubesat", "--duration", "3", "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert document["ended"] == "failed"
    assert "lower" in document["reason"]
    assert document["residual_torque"] is None


@pytest.mark.slow(130)
def test_cubesat_is_balanced_from_anywhere_and_says_truly_how_well(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    words = ["cubesat", "--procedure", "direct", "--random-offset", "--seed", "3"]
    assert main(["balance", *words, "--rrd", str(out), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    recording = open_log(out)
    left = recording["truth_center_of_mass_offset"].value[-1]
    torque = CUBESAT.gravity * np.linalg.norm(left)
    assert torque < 4.3e-5
    assert left[2] < 0.0, "the CM must not pass the CR"
    half = document["residual_torque"]["high"] - document["residual_torque"]["value"]
    assert abs(document["residual_torque"]["value"] - torque) < 3.0 * half / 1.96
    heights = recording["truth_center_of_mass_offset"].value[200:, 2]
    assert (heights < 0.0).all(), "from below, all the way"


@pytest.mark.slow(390)
def test_cubesat_is_balanced_by_its_gravity_vector_alone_and_says_truly_how_well(tmp_path, capsys):
    out = tmp_path / "out.rrd"
    words = ["cubesat:imu", "--random-offset", "--seed", "1", "--rrd", str(out), "--json"]
    assert main(["balance", *words]) == 0
    document = json.loads(capsys.readouterr().out)
    left = open_log(out)["truth_center_of_mass_offset"].value[-1]
    torque = CUBESAT.gravity * np.linalg.norm(left)
    assert torque < 4.3e-5
    half = document["residual_torque"]["high"] - document["residual_torque"]["value"]
    assert abs(document["residual_torque"]["value"] - torque) < 3.0 * half / 1.96
