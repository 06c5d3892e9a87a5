"""The emulated microcontroller obeys the link's table: time-to-live, safe states, its own clock."""

import numpy as np
import pytest

from twin.emulate.microcontroller import (
    FAULTS,
    EmulatedMicrocontroller,
    EmulatedStages,
    EmulatedWheels,
)
from twin.errors import UnknownName
from twin.plant.devices.device import Sample
from twin.plant.devices.link import Channel, FarEndState, Schema
from twin.plant.devices.link.near_end import NearEnd

SCHEMA = Schema(
    (
        Channel("gyro", "rad/s", 3),
        Channel("stage_position", "m", 3, "int32", 2e-6),
        Channel("wheel_speed", "rad/s", 2),
        Channel("command_stage_position", "m", 3, "int32", 2e-6, "hold"),
        Channel("command_wheel_torque", "N m", 2, safe="zero"),
        Channel("command_dipole", "A m^2", 3, safe="zero"),
    )
)
RATES = {"gyro": 100.0, "stage_position": 20.0, "wheel_speed": 41.0}
HOST = 5000.0
"""Host's clock as the emulated time begins [s]."""


class Bench:
    """Both ends in lockstep over a line with a delay, without a port or a real clock."""

    def __init__(self, delay: float = 1e-3, **settings) -> None:
        self.stages = EmulatedStages(3, speed=0.02, acceleration=0.1)
        self.wheels = EmulatedWheels(np.full(2, 0.02), torque_limit=0.5)
        self.micro = EmulatedMicrocontroller(
            SCHEMA, RATES, stages=self.stages, wheels=self.wheels, **settings
        )
        self.near = NearEnd(SCHEMA, "bench")
        self.samples: list[Sample] = []
        self.delay = delay
        self.now = 0.0

    def say(self, data: bytes) -> None:
        self.now += self.delay
        said = self.micro.receive(data, self.now)
        self.now += self.delay
        self.samples += self.near.hear(said, HOST + self.now)

    def run(self, duration: float, *, sync: bool = False) -> None:
        end = self.now + duration
        while self.now < end - 1e-9:
            if sync:
                self.say(self.near.ask_time(HOST + self.now))
            self.now = min(self.now + 0.01, end)
            said = self.micro.advance(self.now - self.delay)
            self.samples += self.near.hear(said, HOST + self.now)

    def armed(self) -> "Bench":
        self.say(self.near.greet(HOST + self.now))
        self.say(self.near.arm(500, HOST + self.now))
        assert self.near.state is FarEndState.armed
        return self

    def tell(self, valid_ms: int = 200, **command) -> None:
        values = {f"command_{name}": np.array(value) for name, value in command.items()}
        self.say(self.near.setpoints(values, valid_ms, HOST + self.now))

    def fly(self, duration: float, **command) -> None:
        """Renew a command twenty times a second."""
        for _ in range(round(duration / 0.05)):
            self.tell(**command)
            self.run(0.05 - 2 * self.delay)

    def stream(self, name: str) -> list[Sample]:
        return [sample for sample in self.samples if sample.stream == name]


def test_a_stage_goes_where_it_is_told_within_speed_and_acceleration():
    bench = Bench().armed()
    bench.fly(2.0, stage_position=[0.01, -0.004, 0.0])
    places = np.array([sample.value for sample in bench.stream("stage_position")])
    np.testing.assert_allclose(places[-1], [0.01, -0.004, 0.0], atol=1e-9)
    assert np.abs(np.diff(places, axis=0)).max() <= 0.02 / 20.0 + 2e-6
    assert places.max() <= 0.01 + 1e-9, "no overshoot"


def test_a_host_that_falls_silent_leaves_the_stage_held_by_its_ramp():
    bench = Bench().armed()
    bench.fly(0.4, stage_position=[0.02, 0.0, 0.0])
    died = bench.stages.position[0]
    bench.run(2.0)
    assert bench.near.state is FarEndState.safe
    assert bench.near.event_sentences()[-1] == (
        "bench: no new set-point came in time on channel 3; it is safe"
    )
    # 0.2 s of validity at 20 mm/s, and 2 mm of braking at 0.1 m/s^2
    assert 0.0 < bench.stages.position[0] - died < 0.2 * 0.02 + 0.02**2 / 0.2 + 1e-4
    held = bench.stages.position.copy()
    bench.run(1.0)
    np.testing.assert_array_equal(bench.stages.position, held)


def test_a_host_that_falls_silent_leaves_wheels_coasting_and_coils_without_current():
    bench = Bench().armed()
    bench.fly(0.5, wheel_torque=[0.1, -0.1], dipole=[0.5, 0.0, -0.5])
    np.testing.assert_allclose(bench.micro.dipole, [0.5, 0.0, -0.5])
    bench.run(0.5)
    speed = bench.wheels.speed.copy()
    assert speed[0] > 2.0, "it must spin for this to say anything"
    bench.run(1.0)
    np.testing.assert_array_equal(bench.wheels.speed, speed)
    np.testing.assert_array_equal(bench.micro.dipole, 0.0)


def test_one_channel_that_runs_out_makes_all_of_them_safe():
    bench = Bench().armed()
    bench.tell(valid_ms=100, dipole=[1.0, 0.0, 0.0])
    for _ in range(4):
        bench.tell(valid_ms=500, wheel_torque=[0.1, 0.1])
        bench.run(0.05)
    assert bench.near.state is FarEndState.safe
    np.testing.assert_array_equal(bench.micro.dipole, 0.0)


def test_armed_and_never_told_anything_it_is_safe_again():
    bench = Bench().armed()
    bench.run(0.6)
    assert bench.near.state is FarEndState.safe
    assert "channel 255" in bench.near.event_sentences()[-1]


@pytest.mark.parametrize("valid_ms", [0, 501])
def test_a_set_point_without_an_end_in_sight_is_refused(valid_ms: int):
    bench = Bench().armed()
    bench.tell(valid_ms=valid_ms, dipole=[1.0, 0.0, 0.0])
    bench.run(0.01)
    assert "refused" in bench.near.event_sentences()[-1]
    np.testing.assert_array_equal(bench.micro.dipole, 0.0)


def test_its_clock_is_fitted_with_offset_and_drift_within_the_bounds():
    bench = Bench(clock_us=2**32 - 3_000_000, drift=80e-6, delay=5e-4)
    bench.say(bench.near.greet(HOST))
    bench.run(30.0, sync=True)
    estimate = bench.near.clock.estimate
    assert estimate is not None
    assert bench.near.clock.restarts == 0, "the clock wraps after three seconds"
    assert abs(1.0 / (1.0 + 80e-6) - 1.0 - estimate.drift) <= estimate.drift_half_width < 1e-4
    newest = bench.stream("gyro")[-1]
    assert newest.device_time is not None
    # the sample at k x 10 ms of emulated time, to a millisecond of main loop
    host = estimate.host(newest.device_time) - HOST
    assert abs(host - np.round(host / 0.01) * 0.01) <= estimate.half_width + 1.1e-3
    assert estimate.half_width < 1e-3
    assert newest.latency == pytest.approx(newest.host_time - HOST - host, abs=1e-6)


def test_samples_come_at_their_rates_and_their_stamps_never_stand():
    bench = Bench()
    bench.run(4.0)
    for stream, rate in RATES.items():
        samples = bench.stream(stream)
        assert len(samples) == pytest.approx(4.0 * rate, abs=2)
        stamps = np.array([sample.device_time for sample in samples])
        assert np.all(np.diff(stamps) > 0.0)


def test_muted_it_still_enforces_the_time_to_live():
    bench = Bench().armed()
    bench.fly(0.2, dipole=[1.0, 0.0, 0.0])
    bench.micro.inject("mute", 10.0)
    count = len(bench.samples)
    bench.run(0.3)
    assert len(bench.samples) == count
    np.testing.assert_array_equal(bench.micro.dipole, 0.0)


def test_deaf_it_runs_out_of_time():
    bench = Bench().armed()
    bench.micro.inject("deaf", 10.0)
    bench.fly(0.6, dipole=[1.0, 0.0, 0.0])
    assert bench.near.state is FarEndState.safe


def test_hung_it_enforces_nothing_until_it_goes_on():
    bench = Bench().armed()
    bench.fly(0.2, dipole=[1.0, 0.0, 0.0])
    bench.micro.inject("hang", 1.0)
    bench.run(0.9)
    assert bench.micro.dipole[0] == 1.0, "a lab needs the hardware watchdog for this"
    bench.run(0.3)
    np.testing.assert_array_equal(bench.micro.dipole, 0.0)


def test_after_a_reset_it_is_safe_and_the_host_knows():
    bench = Bench().armed()
    bench.fly(0.5, stage_position=[0.004, 0.0, 0.0], dipole=[1.0, 0.0, 0.0])
    bench.micro.inject("reset")
    bench.run(0.1)
    assert bench.near.restarted
    assert bench.near.state is FarEndState.safe
    np.testing.assert_array_equal(bench.micro.dipole, 0.0)
    bench.near = NearEnd(SCHEMA, "the next session")
    bench.run(0.1)
    assert bench.stream("stage_position")[-1].value == (0.0, 0.0, 0.0), "its counter began anew"
    assert bench.stages.position[0] > 0.003, "the mass did not"


def test_frames_that_are_lost_or_damaged_are_counted_and_nothing_false_comes_through():
    bench = Bench()
    bench.micro.shown["gyro"] = np.array([0.1, 0.2, 0.3])
    bench.run(0.5)
    bench.micro.inject("gap", 7)
    bench.micro.inject("corrupt", 5)
    bench.run(0.5)
    counters = bench.near.parser.counters
    assert counters.bad_checksum + counters.malformed == 5
    assert counters.gaps == 12
    shown = np.array([sample.value for sample in bench.stream("gyro")])
    np.testing.assert_array_equal(shown, np.float32([[0.1, 0.2, 0.3]] * len(shown)))


def test_samples_that_come_again_with_their_old_stamps_are_dropped():
    bench = Bench()
    bench.run(0.5)
    count = len(bench.samples)
    bench.micro.inject("stale", 0.3)
    bench.run(0.3)
    assert len(bench.samples) - count <= 3, "one a channel at most was on its way"
    assert bench.near.stale > 20
    bench.run(0.3)
    assert len(bench.samples) - count > 20


def test_a_stuck_sensor_shows_one_value_with_new_stamps():
    bench = Bench().armed()
    bench.micro.inject("stuck", 5.0)
    bench.fly(0.5, stage_position=[0.01, 0.0, 0.0])
    assert {sample.value for sample in bench.stream("stage_position")[1:]} == {(0.0, 0.0, 0.0)}
    assert bench.stages.position[0] > 0.002


def test_a_fault_must_be_acknowledged_before_it_can_be_armed_again():
    bench = Bench().armed()
    bench.micro.inject("fault", 2.0)
    bench.run(0.02)
    assert bench.near.state is FarEndState.fault
    assert bench.near.event_sentences()[-1] == "bench: LIMIT (2)"
    bench.say(bench.near.arm(500, HOST + bench.now))
    assert bench.near.state is FarEndState.fault
    bench.say(bench.near.disarm(HOST + bench.now))
    bench.say(bench.near.arm(500, HOST + bench.now))
    assert bench.near.state is FarEndState.armed


def test_a_clock_that_changes_its_pace_is_fitted_anew():
    bench = Bench(delay=2e-4)
    bench.say(bench.near.greet(HOST))
    bench.run(10.0, sync=True)
    bench.micro.inject("drift", 3e-3)
    bench.run(10.0, sync=True)
    estimate = bench.near.clock.estimate
    assert estimate is not None
    assert bench.near.clock.restarts >= 1
    assert abs(1.0 / 1.003 - 1.0 - estimate.drift) <= estimate.drift_half_width


def test_a_power_cycle_forgets_everything():
    bench = Bench().armed()
    bench.micro.inject("mute", 100.0)
    bench.micro.power_cycle(bench.now)
    bench.run(0.1)
    assert bench.near.restarted
    assert bench.near.heard > HOST


def test_a_fault_that_it_does_not_know_is_refused():
    with pytest.raises(UnknownName, match="fault of a microcontroller"):
        Bench().micro.inject("mutt")
    assert all(sentence[0].islower() for sentence in FAULTS.values())
