"""The guard's rules, each with its sentence, on machines that do as they are shown."""

import re
import time
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from twin.clock import SimulatedClock
from twin.controller.load import load_controller
from twin.errors import SafetyError, UsageError
from twin.estimators.named import load_estimator
from twin.loop import Ended, fly
from twin.plant.guard.guarded import Guarded, Held, Phase
from twin.plant.guard.rules import RULES
from twin.plant.guard.settings import GuardSettings, guard_settings
from twin.plant.plant import Plant
from twin.plant.simulated import InitialState, SimulatedPlant
from twin.platform import Platform, load_platform
from twin.reference import Hold
from twin.rotation import from_rotation_vector
from twin.signals import Command, Reading, Samples

SETTINGS = GuardSettings(
    max_balance_step=0.05, tilt_cutout=np.radians(20.0), stroke_margin=5e-3, stale_cycles=5
)


class Scripted(Plant):
    """Shows what it is told to show, and keeps what it is told to do."""

    def __init__(self, platform: Platform) -> None:
        self.platform, self.n, self.stopped = platform, 1, {}
        self.shown = {
            "attitude": np.array([1.0, 0.0, 0.0, 0.0]),
            "gyro": np.zeros(3),
            "stage_position": np.zeros(len(platform.stages)),
            "wheel_speed": np.zeros(len(platform.wheels)),
            "gimbal_angle": np.zeros(len(platform.gimbals)),
            "floating": np.ones(1),
        }
        if "inclinometer" in platform.sensors:
            self.shown["inclinometer"] = np.zeros(2)
        self.silent: set[str] = set()
        self.told: list[Command] = []
        self.safe: list[tuple[Command, bool]] = []

    def read(self, until: float) -> Reading:
        stamp, valid = np.full((1, 1), until), np.ones((1, 1), dtype=np.bool_)
        return Reading(
            until,
            {
                name: Samples(value.reshape(1, 1, -1).astype(float), stamp, valid)
                for name, value in self.shown.items()
                if value.size and name not in self.silent
            },
        )

    def write(self, command: Command) -> Command:
        self.told.append({name: value.copy() for name, value in command.items()})
        return dict(command)

    def safe_stop(self, rest: Command, *, floating: bool) -> None:
        self.safe.append((rest, floating))


class Bench:
    """A guarded machine, and the ticks of its loop."""

    def __init__(self, name: str = "sads", settings: GuardSettings = SETTINGS, **changes) -> None:
        self.platform = replace(load_platform(name), **changes)
        self.plant = Scripted(self.platform)
        self.guard = Guarded(self.plant, settings, calibrated=True)
        self.tick = 0
        self.read()

    def read(self, ticks: int = 1) -> None:
        for _ in range(ticks):
            self.guard.read(self.tick * self.platform.tick)
            self.tick += 1

    def armed(self) -> "Bench":
        self.guard.arm("arm")
        return self

    def tell(self, **command) -> Command:
        """Read and write once; what was applied, (columns,) each."""
        self.read()
        wish = {f"command_{name}": np.array([value]) for name, value in command.items()}
        return {name: value[0] for name, value in self.guard.write(wish).items()}

    def is_safe(self, sentence: str) -> bool:
        """Stopped for that reason, told once, and nothing leaves any more."""
        count = len(self.plant.told)
        self.tell()
        return (
            self.guard.phase is Phase.stopped
            and sentence in self.guard.safe_reason
            and self.guard.stopped == {0: self.guard.safe_reason}
            and len(self.plant.safe) == 1
            and len(self.plant.told) == count
        )


# ---- arming


def test_it_begins_disarmed_and_computes_without_sending():
    bench = Bench()
    applied = bench.tell(wheel_torque=[0.1, 0.1, 0.1], stage_position=[0.01, 0.0, 0.0])
    assert bench.guard.phase is Phase.disarmed
    assert bench.plant.told == []
    assert all(not value.any() for value in applied.values())


@pytest.mark.parametrize("said", ["", "y", "yes", "ARM"])
def test_only_the_word_arms_it(said: str):
    bench = Bench()
    with pytest.raises(SafetyError, match="nobody has said so; type 'arm', each session"):
        bench.guard.arm(said)
    assert bench.guard.phase is Phase.disarmed


def test_without_a_calibration_file_it_is_not_armed():
    guard = Guarded(Scripted(load_platform("sads")), SETTINGS, calibrated=False)
    guard.read(0.0)
    with pytest.raises(SafetyError, match="no calibration file; calibrate this machine"):
        guard.arm("arm")


def test_without_a_signal_somebody_must_say_whether_it_floats():
    bench = Bench()
    bench.plant.silent = {"floating"}
    bench.guard.seen.newest.pop("floating")
    with pytest.raises(SafetyError, match="no signal says .*; look, and type 'floating' or"):
        bench.guard.arm("arm")
    assert bench.guard.floating, "where nobody knows, it may float"
    bench.guard.arm("arm", held=Held.captured)
    assert not bench.guard.floating


def test_the_operator_does_not_overrule_the_air():
    bench = Bench()
    with pytest.raises(SafetyError, match="never go by the word alone"):
        bench.guard.arm("arm", held=Held.captured)
    with pytest.raises(SafetyError, match="never go by the word alone"):
        bench.guard.captured()


def test_a_silent_sensor_keeps_it_from_being_armed():
    bench = Bench()
    bench.plant.silent = {"gyro"}
    bench.read(4)
    with pytest.raises(SafetyError, match="no fresh sample of gyro .*check the device"):
        bench.guard.arm("arm")


def test_tilted_it_is_not_armed():
    bench = Bench()
    bench.plant.shown["attitude"] = from_rotation_vector(np.array([0.5, 0.0, 0.0]))
    bench.read()
    with pytest.raises(SafetyError, match="it leans by 28.6 deg, more than the 20.0 deg.*level"):
        bench.guard.arm("arm")


def test_without_a_sensor_of_tilt_there_is_no_cut_out_and_no_arming():
    bench = Bench()
    bench.guard.seen.newest.pop("attitude")
    bench.guard.seen._needed = ()
    bench.guard.seen._stale.clear()
    with pytest.raises(SafetyError, match="no sensor tells the tilt"):
        bench.guard.arm("arm")


def test_a_stop_must_be_armed_anew():
    bench = Bench().armed()
    bench.guard.stop("a reason")
    assert bench.is_safe("a reason")
    bench.guard.arm("arm")
    assert bench.guard.safe_reason == ""
    assert bench.guard.stopped == {}
    bench.tell(wheel_torque=[0.1, 0.0, 0.0])
    assert bench.plant.told[-1]["command_wheel_torque"][0, 0] == 0.1


def test_a_batch_of_runs_is_no_machine():
    with pytest.raises(UsageError, match="not for a batch of 3"):
        Guarded(SimulatedPlant(load_platform("sads"), runs=range(3)), SETTINGS, calibrated=True)


# ---- what stops it


def test_a_command_that_is_not_a_number_stops_it():
    bench = Bench().armed()
    bench.tell(wheel_torque=[0.0, np.nan, 0.0])
    assert bench.is_safe("command_wheel_torque w2 is nan: the law has failed")


def test_beyond_the_tilt_cut_out_all_stops():
    bench = Bench().armed()
    bench.plant.shown["attitude"] = from_rotation_vector(np.array([0.0, 0.36, 0.0]))
    assert bench.is_safe("it leans by 20.6 deg, more than the 20.0 deg at which all stops")


def test_an_inclinometer_cuts_out_where_there_is_no_attitude():
    bench = Bench().armed()
    bench.plant.shown["inclinometer"] = np.array([0.3, -0.3])
    assert bench.is_safe("it leans by 24.7 deg")


def test_a_stale_stream_stops_it_after_the_cycles_that_are_allowed():
    bench = Bench().armed()
    bench.plant.silent = {"gyro"}
    bench.read(SETTINGS.stale_cycles)  # in the first period the last sample is still fresh
    assert bench.guard.phase is Phase.armed
    bench.read(2)
    assert bench.is_safe("gyro is stale: nothing valid for")


def test_samples_that_are_not_valid_are_no_samples():
    bench = Bench().armed()
    bench.plant.shown["gyro"] = np.full(3, np.nan)
    honest = bench.plant.read

    def read(until: float) -> Reading:
        reading = honest(until)
        gyro = reading.streams["gyro"]
        lost = replace(gyro, valid=np.zeros_like(gyro.valid))
        return replace(reading, streams=dict(reading.streams) | {"gyro": lost})

    bench.plant.read = read
    bench.read(10)
    assert bench.is_safe("gyro is stale")


def test_lost_air_stops_it():
    bench = Bench().armed()
    bench.plant.shown["floating"] = np.zeros(1)
    assert bench.is_safe("the air was lost: the table is coming down")


def test_lost_air_is_seen_by_its_pressure_where_only_that_is_measured():
    bench = Bench(settings=replace(SETTINGS, air_pressure=3e5))
    bench.plant.silent = {"floating"}
    bench.guard.seen.newest.pop("floating")
    bench.plant.shown["air_pressure"] = np.array([4e5])
    bench.read()
    bench.armed()
    bench.plant.shown["air_pressure"] = np.array([2e5])
    assert bench.is_safe("the air was lost")


def test_a_position_that_jumps_while_floating_stops_it_until_it_was_captured():
    bench = Bench().armed()
    bench.plant.shown["stage_position"] = np.array([0.0, 0.05, 0.0])
    assert bench.is_safe("masses hold, wheels coast: capture it first")
    assert "reads 50.00 mm after 0.00 mm 0.05 s before" in bench.guard.safe_reason
    with pytest.raises(SafetyError, match="not armed: stage .* capture it first, then home"):
        bench.guard.arm("arm")
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.guard.captured()
    bench.plant.shown["floating"] = np.ones(1)
    bench.read()
    bench.guard.arm("arm")


def test_a_loop_that_hangs_is_stopped_by_the_watchdog():
    bench = Bench(settings=replace(SETTINGS, watchdog=0.1)).armed()
    for _ in range(5):
        bench.tell(wheel_torque=[0.1, 0.0, 0.0])
        time.sleep(0.04)
    assert bench.guard.phase is Phase.armed
    time.sleep(0.3)
    assert bench.is_safe("no command for 0.1")
    rest, _ = bench.plant.safe[0]
    assert not rest["command_wheel_torque"].any()


def test_closing_it_armed_leaves_it_safe():
    bench = Bench().armed()
    bench.tell(wheel_torque=[0.1, 0.0, 0.0])
    bench.guard.close()
    assert len(bench.plant.safe) == 1
    assert bench.guard.phase is Phase.disarmed


def test_a_sample_that_comes_late_does_not_replace_a_newer_one():
    bench = Bench().armed()
    bench.read(3)
    newest = bench.guard.seen.newest["stage_position"][0]
    honest = bench.plant.read

    def late(until: float) -> Reading:
        reading = honest(until)
        old = reading.streams["stage_position"]
        old = replace(old, time=old.time - 10.0, value=old.value + 0.05)
        return replace(reading, streams=dict(reading.streams) | {"stage_position": old})

    bench.plant.read = late
    bench.read()
    assert bench.guard.seen.newest["stage_position"][0] == newest
    assert not bench.guard.seen.lost


# ---- the safe state


def test_wheels_are_let_coast_and_stages_hold_where_their_ramps_end():
    bench = Bench().armed()
    bench.plant.shown["wheel_speed"] = np.array([100.0, -50.0, 0.0])
    bench.plant.shown["stage_position"] = np.array([2e-4, 0.0, 0.0])
    bench.tell(wheel_torque=[0.2, 0.2, 0.2], stage_position=[9e-4, 0.0, 0.0])
    bench.guard.stop("enough")
    rest, floating = bench.plant.safe[0]
    assert floating
    assert not rest["command_wheel_torque"].any(), "zero torque: coasting, never braked"
    stage = bench.platform.stages[0]
    ramp = 0.5 * stage.speed**2 / stage.acceleration
    target = bench.plant.told[-1]["command_stage_position"][0, 0]
    held = rest["command_stage_position"][0, 0]
    assert 2e-4 < held <= min(2e-4 + ramp, target), "it brakes onwards, and never turns back"


@pytest.mark.parametrize(
    ("machine", "command", "width"),
    [
        ("tas2", "gimbal_rate", 3),
        ("cubesat", "dipole", 3),
        ("astros", "thruster", 12),
        ("sads", "wheel_torque", 3),
    ],
)
def test_at_rest_gimbals_stand_coils_are_off_and_thrusters_are_closed(
    machine: str, command: str, width: int
):
    bench = Bench(machine).armed()
    applied = bench.tell(**{command: np.full(width, 0.01)})
    assert applied[f"command_{command}"].any()
    bench.guard.stop("enough")
    rest, _ = bench.plant.safe[0]
    assert not rest[f"command_{command}"].any()


@pytest.mark.parametrize("what", ["homing", "zeroing", "a move from end to end"])
def test_homing_and_full_strokes_are_for_a_captured_table(what: str):
    bench = Bench()
    with pytest.raises(SafetyError, match=f"{what} refused: the table floats.*capture it"):
        bench.guard.captured_only(what)
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.guard.captured_only(what)


# ---- what limits a command


def moved(bench: Bench, target: list[float]) -> np.ndarray:
    """Where a wish sends the stages, from where they are [m]."""
    applied = bench.tell(stage_position=target)["command_stage_position"]
    return applied - bench.plant.shown["stage_position"]


def test_one_move_while_floating_changes_the_gravity_torque_by_no_more_than_a_step():
    bench = Bench(settings=replace(SETTINGS, max_balance_step=2e-3)).armed()
    lead = moved(bench, [0.05, -0.02, 0.0])
    slides = np.array([stage.mass * stage.axis for stage in bench.platform.stages])
    torque = bench.platform.gravity * np.linalg.norm(lead @ slides)
    assert 0.9 * 2e-3 < torque <= 2e-3
    assert bench.guard.limited["balance_step"] == 1


def test_captured_a_move_is_limited_by_its_drive_alone():
    bench = Bench(settings=replace(SETTINGS, max_balance_step=2e-3))
    bench.plant.shown["floating"] = np.zeros(1)
    bench.read()
    bench.armed()
    lead = moved(bench, [0.05, 0.0, 0.0])
    assert lead[0] == pytest.approx(bench.platform.stages[0].speed * SETTINGS.horizon)
    assert bench.guard.limited == {"rate": 1}


@pytest.mark.parametrize("margin", [0.0, 1e-4])
def test_no_move_while_floating_brings_the_cm_up_to_the_cr(margin: float):
    below = np.array([0.0, 0.0, -1e-3])
    settings = replace(SETTINGS, max_balance_step=np.inf, height_margin=margin)
    bench = Bench(settings=settings, center_of_mass_offset=below).armed()
    axes = np.array([stage.axis for stage in bench.platform.stages])
    up = int(np.argmax(np.abs(axes[:, 2])))
    place = np.zeros(3)
    for _ in range(200):
        wish = place.copy()
        wish[up] = 0.1 * np.sign(axes[up, 2])
        bench.plant.shown["stage_position"] = place = place + moved(bench, wish.tolist())
    height = bench.guard._rules.height(place)
    resolution = bench.platform.stages[up].resolution * bench.platform.stages[up].mass
    assert -margin - 2.0 * resolution <= height <= -margin
    assert bench.guard.limited["height"] > 0


def test_top_heavy_it_may_only_go_down():
    above = np.array([0.0, 0.0, 1e-3])
    settings = replace(SETTINGS, max_balance_step=np.inf)
    bench = Bench(settings=settings, center_of_mass_offset=above).armed()
    axes = np.array([stage.axis for stage in bench.platform.stages])
    up = int(np.argmax(np.abs(axes[:, 2])))
    rise = np.zeros(3)
    rise[up] = 1e-3 * np.sign(axes[up, 2])
    np.testing.assert_array_equal(moved(bench, rise.tolist()), 0.0)
    np.testing.assert_allclose(moved(bench, (-rise).tolist()), -rise)


def test_a_stage_keeps_off_its_ends():
    settings = replace(SETTINGS, max_balance_step=np.inf, horizon=100.0)
    bench = Bench(settings=settings, center_of_mass_offset=np.array([0.0, 0.0, -1.0])).armed()
    stages = bench.platform.stages
    np.testing.assert_allclose(
        moved(bench, [9.0, 9.0, 9.0]), [stage.travel[1] - 5e-3 for stage in stages]
    )
    np.testing.assert_allclose(
        moved(bench, [-9.0, -9.0, -9.0]), [stage.travel[0] + 5e-3 for stage in stages]
    )
    assert bench.guard.limited["stroke"] == 2


def test_no_motor_is_asked_for_more_than_it_has():
    bench = Bench().armed()
    applied = bench.tell(wheel_torque=[2.0, -2.0, 0.1])
    np.testing.assert_allclose(applied["command_wheel_torque"], [0.5, -0.5, 0.1])
    assert bench.guard.limited["torque"] == 1
    coils = Bench("cubesat").armed()
    np.testing.assert_allclose(
        coils.tell(dipole=[3.0, 0.0, -0.5])["command_dipole"], [1.0, 0.0, -0.5]
    )
    assert coils.guard.limited["torque"] == 1
    gas = Bench("astros").armed()
    assert gas.tell(thruster=[-1.0] * 12)["command_thruster"].min() == 0.0
    gyros = Bench("tas2").armed()
    rate = gyros.tell(gimbal_rate=[99.0, 0.0, 0.0])["command_gimbal_rate"][0]
    assert rate == gyros.platform.gimbals[0].rate
    assert gyros.guard.limited["rate"] == 1


def test_a_wheel_near_its_limit_is_turned_no_faster_and_not_braked_either():
    bench = Bench().armed()
    wheel = bench.platform.wheels[0]
    bench.plant.shown["wheel_speed"] = np.array([0.95 * wheel.speed_limit, 0.0, 0.0])
    assert bench.tell(wheel_torque=[0.1, 0.0, 0.0])["command_wheel_torque"][0] == 0.0
    assert bench.tell(wheel_torque=[-0.1, 0.0, 0.0])["command_wheel_torque"][0] == -0.1
    assert bench.guard.limited["momentum"] == 1


def test_a_torque_that_is_held_while_speeds_are_not_measured_fills_no_wheel():
    bench = Bench().armed()
    bench.plant.silent = {"wheel_speed"}
    torques = [bench.tell(wheel_torque=[0.5, 0.0, 0.0])["command_wheel_torque"][0]]
    while torques[-1] > 0.0 and len(torques) < 1000:
        torques.append(bench.tell()["command_wheel_torque"][0])
    gained = sum(torques) * bench.platform.tick
    share = SETTINGS.momentum_share * bench.platform.wheels[0].momentum_limit
    assert gained == pytest.approx(share)


# ---- around the simulated machine


def test_a_run_on_the_simulated_table_ends_safely_with_the_reason():
    platform = load_platform("sads")
    heavy = replace(platform, center_of_mass_offset=np.array([0.05, 0.02, 0.01]))
    plant = SimulatedPlant(heavy, initial=InitialState())
    guard = Guarded(plant, guard_settings(platform), calibrated=True)
    guard.read(0.0)
    guard.arm("arm", held=Held.floating)
    outcome = fly(
        guard,
        load_estimator("passthrough"),
        load_controller("quaternion_pd"),
        Hold(),
        SimulatedClock(),
        duration=60.0,
    )
    assert outcome.ended is Ended.safe_stop
    assert "deg at which all stops" in outcome.reason
    speed = plant.truth()["truth_wheel_speed"].value[0, 0]
    assert np.abs(speed).max() > 1.0, "wheels are left turning"


def test_settings_of_a_machine_of_which_nothing_is_stated():
    settings = guard_settings(load_platform("sads"))
    assert 0.0 < settings.max_balance_step < 1.0
    assert settings.tilt_cutout == pytest.approx(0.8 * load_platform("sads").stop_angle)
    assert guard_settings(load_platform("dfki_pendulum")).max_balance_step == np.inf


def test_the_document_names_every_rule_and_every_number():
    document = (Path(__file__).parents[3] / "docs" / "safety.md").read_text(encoding="utf-8")
    assert re.findall(
        r"^\| (\w+) \| (?!then)", document.split("| rule |")[1], re.MULTILINE
    ) == list(RULES)
    for field in fields(GuardSettings):
        assert f"`{field.name}`" in document, field.name
