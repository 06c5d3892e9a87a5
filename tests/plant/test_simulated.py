"""The simulated plant keeps its promises to the loop: clocks, limits, seeds, and runs that fail."""

from dataclasses import replace

import numpy as np
import pytest

from twin.api import fly
from twin.effects import effect_named, with_effects
from twin.errors import CommandError, UnknownName, UsageError
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import conjugate, from_rotation_vector, multiply, tilt, to_rotation_vector


@pytest.fixture(scope="module")
def sads() -> Platform:
    return load_platform("sads")


def perfect(platform: Platform, **changes) -> Platform:
    """The platform with sensors that show the truth, but for what `changes` says of the gyro."""
    sensors = {
        name: replace(sensor, noise=0.0 * sensor.noise, bias=0.0 * sensor.bias, resolution=0.0)
        for name, sensor in platform.sensors.items()
    }
    return replace(platform, sensors=sensors | {"gyro": replace(sensors["gyro"], **changes)})


def with_gyro(platform: Platform, **changes) -> Platform:
    gyro = replace(platform.sensors["gyro"], **changes)
    return replace(platform, sensors=dict(platform.sensors) | {"gyro": gyro})


def flown(platform: Platform, ticks: int, **settings) -> list:
    """Readings and truth of a few ticks under wheel torques that differ from run to run."""
    plant = SimulatedPlant(platform, **settings)
    numbers = np.array(settings.get("runs", (0,)))
    seen = []
    for k in range(ticks + 1):
        reading = plant.read(k * platform.tick)
        seen.append((reading, plant.truth()))
        torque = 0.1 * np.sin(0.3 * k + numbers[:, None] + np.arange(3))
        masses = 1e-3 * np.cos(0.2 * k + numbers[:, None] + np.arange(3))
        plant.write({"command_wheel_torque": torque, "command_stage_position": masses})
    return seen


def differing(one: list, other: list, row: int) -> list[str]:
    """Streams in which row `row` of a batch is not, bit for bit, row 0 of its replay."""
    return [
        name
        for (reading, truth), (again, true_again) in zip(one, other, strict=True)
        for streams, replayed in ((reading.streams, again.streams), (truth, true_again))
        for name in streams
        if not np.array_equal(streams[name].value[row], replayed[name].value[0])
    ]


def test_run_i_of_256_is_run_i_replayed_as_two_equal_rows_bit_for_bit(sads):
    initial = InitialState(rate_body=np.array([0.01, -0.02, 0.03]))
    batch = flown(sads, 20, runs=range(256), seed=7, initial=initial)
    for run in (0, 17, 255):
        replay = flown(sads, 20, runs=(run, run), seed=7, initial=initial)
        assert differing(batch, replay, run) == []


def test_results_do_not_depend_on_the_number_of_threads(sads):
    one = flown(sads, 10, runs=range(32), seed=3, threads=1)
    three = flown(sads, 10, runs=range(32), seed=3, threads=3)
    for row in range(32):
        assert not [
            name
            for (a, _), (b, _) in zip(one, three, strict=True)
            for name in a.streams
            if not np.array_equal(a.streams[name].value[row], b.streams[name].value[row])
        ]


def test_another_seed_gives_other_noise_and_the_same_truth(sads):
    (first, truth), (second, truth_again) = flown(sads, 3, seed=1)[-1], flown(sads, 3, seed=2)[-1]
    assert not np.array_equal(first.streams["gyro"].value, second.streams["gyro"].value)
    assert np.array_equal(truth["truth_rate"].value, truth_again["truth_rate"].value)


def test_a_reading_holds_every_sample_since_the_last_tick(sads):
    readings = [reading for reading, _ in flown(sads, 40)]
    times = np.concatenate([r.streams["gyro"].time[0] for r in readings])
    np.testing.assert_allclose(times, np.arange(len(times)) * 0.01, atol=1e-12)
    assert readings[5].streams["gyro"].value.shape == (1, 5, 3)


def test_a_41_hz_stream_is_sampled_at_the_next_step_and_stamped_so(sads):
    readings = flown(with_gyro(sads, rate=41.0), 80)
    times = np.concatenate([r.streams["gyro"].time[0] for r, _ in readings if "gyro" in r.streams])
    ideal = np.arange(len(times)) / 41.0
    assert len(times) == int(4.0 * 41.0) + 1
    assert np.all((times - ideal > -1e-9) & (times - ideal < sads.step))
    np.testing.assert_allclose(times / sads.step, np.round(times / sads.step), atol=1e-6)


def test_latency_delays_the_arrival_and_not_the_stamp(sads):
    late = perfect(sads, latency=0.12)
    readings = flown(late, 40)
    prompt = flown(perfect(sads), 40)
    arrived = [
        (r.time, t) for r, _ in readings if "gyro" in r.streams for t in r.streams["gyro"].time[0]
    ]
    assert all(0.12 - 1e-9 <= when - stamp <= 0.12 + sads.tick for when, stamp in arrived)
    value = np.concatenate([r.streams["gyro"].value[0] for r, _ in readings if "gyro" in r.streams])
    truth = np.concatenate([r.streams["gyro"].value[0] for r, _ in prompt])
    assert np.array_equal(value, truth[: len(value)]), "a late sample must be the one it was"


def test_noise_bias_dropouts_quantisation_and_saturation_are_those_stated(sads, drawn_seed: int):
    noisy = with_gyro(
        sads,
        noise=np.array([0.02, 0.01, 0.005]),
        bias=np.full(3, 0.1),
        dropout=0.2,
        resolution=1e-3,
    )
    readings = flown(noisy, 100, runs=range(64), seed=drawn_seed)
    true = flown(perfect(sads), 100, runs=range(64), seed=drawn_seed)
    value = np.concatenate([r.streams["gyro"].value for r, _ in readings], axis=1)
    exact = np.concatenate([r.streams["gyro"].value for r, _ in true], axis=1)
    valid = np.concatenate([r.streams["gyro"].valid for r, _ in readings], axis=1)
    error = value - exact
    np.testing.assert_allclose(
        (error - error.mean(axis=1, keepdims=True)).std(axis=(0, 1)), [0.02, 0.01, 0.005], rtol=0.05
    )
    assert error.mean(axis=1).std() == pytest.approx(0.1, rel=0.3)
    assert 1.0 - valid.mean() == pytest.approx(0.2, abs=0.02)
    np.testing.assert_allclose(value / 1e-3, np.round(value / 1e-3), atol=1e-6)

    narrow = flown(perfect(sads, range=0.002), 40)
    largest = max(np.abs(r.streams["gyro"].value).max() for r, _ in narrow)
    assert largest == 0.002


def test_attitude_noise_turns_the_body_about_its_own_axes(sads):
    noise = np.array([0.02, 0.002, 0.01])
    attitude = replace(sads.sensors["attitude"], noise=noise)
    platform = replace(sads, sensors={"attitude": attitude})
    readings = flown(platform, 100, runs=range(16))
    errors = [
        to_rotation_vector(
            multiply(
                conjugate(truth["truth_attitude"].value[:, 0]), r.streams["attitude"].value[:, -1]
            )
        )
        for r, truth in readings
    ]
    np.testing.assert_allclose(np.std(errors, axis=(0, 1)), noise, rtol=0.1)


def test_write_returns_what_is_applied_after_limits(sads):
    plant = SimulatedPlant(sads)
    plant.read(0.0)
    applied = plant.write(
        {
            "command_wheel_torque": np.array([[2.0, -2.0, 0.1]]),
            "command_stage_position": np.array([[0.3, -0.3, 0.0123456]]),
        }
    )
    np.testing.assert_array_equal(applied["command_wheel_torque"], [[0.5, -0.5, 0.1]])
    np.testing.assert_allclose(applied["command_stage_position"], [[0.10, -0.15, 0.012346]])


def test_no_wheel_passes_its_momentum_limit(sads):
    plant = SimulatedPlant(sads)
    plant.read(0.0)
    for k in range(1, 300):
        plant.write({"command_wheel_torque": np.array([[0.5, -0.5, 0.5]])})
        plant.read(k * sads.tick)
    momentum = plant.truth()["truth_wheel_speed"].value[0, 0] * 0.028
    assert np.abs(momentum).max() <= 5.0 * (1.0 + 1e-3)
    assert np.abs(momentum).min() > 4.5


def test_a_command_stands_until_the_next_one(sads):
    plant = SimulatedPlant(sads)
    plant.read(0.0)
    plant.write({"command_wheel_torque": np.array([[0.1, 0.0, 0.0]])})
    plant.read(sads.tick)
    held = plant.write({})
    plant.read(2 * sads.tick)
    np.testing.assert_array_equal(held["command_wheel_torque"], [[0.1, 0.0, 0.0]])
    rise = plant.truth()["truth_wheel_speed"].value[0, 0, 0]
    assert rise == pytest.approx(0.1 * 0.1 / 0.028, rel=0.02)


def test_a_stage_reaches_its_target_within_speed_and_acceleration(sads):
    plant = SimulatedPlant(sads)
    positions = []
    for k in range(400):
        plant.read(k * sads.tick)
        positions.append(plant.truth()["truth_stage_position"].value[0, 0])
        applied = plant.write({"command_stage_position": np.array([[0.05, -0.02, 0.0]])})
    positions = np.array(positions)
    np.testing.assert_array_equal(positions[-1], applied["command_stage_position"][0])
    assert np.abs(np.diff(positions, axis=0)).max() <= sads.stages[0].speed * sads.tick * (1 + 1e-9)
    shortest = 0.05 / sads.stages[0].speed + sads.stages[0].speed / sads.stages[0].acceleration
    arrival = np.argmax(positions[:, 0] == positions[-1, 0]) * sads.tick
    assert shortest <= arrival < shortest + 0.2


def test_each_stage_begins_to_move_its_response_after_it_was_told(sads):
    ticks = (0, 1, 3)
    stages = [
        replace(stage, response=late * sads.tick)
        for stage, late in zip(sads.stages, ticks, strict=True)
    ]
    plant = SimulatedPlant(replace(sads, stages=tuple(stages)))
    moved = []
    for k in range(8):
        plant.read(k * sads.tick)
        moved.append(plant.truth()["truth_stage_position"].value[0, 0] != 0.0)
        plant.write({"command_stage_position": np.full((1, 3), 0.05 if k >= 2 else 0.0)})
    # told at tick 2; what moves in a tick is seen at the next
    assert [int(np.argmax(one)) for one in np.transpose(moved)] == [3 + late for late in ticks]


def test_a_start_beyond_the_tilt_stop_is_refused_with_both_angles(sads):
    lying = from_rotation_vector(np.array([np.radians(60.0), 0.0, 0.0]))
    with pytest.raises(UsageError, match=r"sads would start at 60 deg, beyond the stop at 30 deg"):
        SimulatedPlant(sads, initial=InitialState(attitude=lying))


def test_dry_friction_acts_in_runs_that_have_it_where_the_common_machine_has_none(sads):
    def speeds(common: float) -> np.ndarray:
        kind = effect_named("wheel_friction")
        frictions = [[kind(viscous=0.0, dry=dry)] for dry in (1e-3, 0.0)]
        machine = with_effects(sads, (kind(viscous=0.0, dry=common),))
        plant = SimulatedPlant(machine, runs=range(2), effects=frictions)
        for k in range(20):
            plant.read(k * sads.tick)
            plant.write({"command_wheel_torque": np.full((2, 3), 0.05)})
        return plant.truth()["truth_wheel_speed"].value[:, 0, 0]

    with_none = speeds(common=0.0)
    assert with_none[0] < with_none[1]
    np.testing.assert_array_equal(with_none, speeds(common=1e-3))


def test_the_tilt_stop_holds_the_body(sads):
    heavy = replace(sads, center_of_mass_offset=np.array([0.05, 0.02, 0.01]))
    plant = SimulatedPlant(heavy)
    worst = 0.0
    for k in range(round(20.0 / sads.tick)):
        plant.read(k * sads.tick)
        worst = max(worst, float(tilt(plant.truth()["truth_attitude"].value[0, 0])))
    assert np.degrees(worst) > 29.0, "it must have fallen onto the stop for this to say anything"
    assert np.degrees(worst) < 33.0


def test_a_run_whose_command_is_not_finite_is_stopped_and_the_others_go_on_untouched(sads):
    def states(bad: int | None) -> tuple[dict[int, str], np.ndarray]:
        plant = SimulatedPlant(sads, runs=range(6), seed=1)
        rates = []
        for k in range(20):
            plant.read(k * sads.tick)
            rates.append(plant.truth()["truth_rate"].value[:, 0].copy())
            torque = np.full((6, 3), 0.05)
            if bad is not None and k == 10:
                torque[bad, 1] = np.nan
            plant.write({"command_wheel_torque": torque})
        return plant.stopped, np.array(rates)

    stopped, rates = states(bad=4)
    _, healthy = states(bad=None)
    others = [0, 1, 2, 3, 5]
    assert stopped == {4: "command_wheel_torque w2 is nan (at 0.500 s)"}
    assert np.array_equal(rates[:, others], healthy[:, others])


def test_a_run_that_diverges_is_stopped_with_the_reason_and_litters_nowhere(
    sads, tmp_path, monkeypatch, capfd
):
    monkeypatch.chdir(tmp_path)
    rates = np.zeros((3, 3))
    rates[1] = 2e3
    plant = SimulatedPlant(sads, runs=range(3), initial=InitialState(rate_body=rates))
    plant.read(0.0)
    reading = plant.read(sads.tick)
    assert list(plant.stopped) == [1]
    assert "diverged" in plant.stopped[1]
    assert list(plant.stopped_at) == [1]
    assert 0.0 <= plant.stopped_at[1] <= sads.tick
    assert list(tmp_path.iterdir()) == []
    assert capfd.readouterr().err == ""
    assert reading.streams["gyro"].valid[:, -1].tolist() == [True, False, True]


@pytest.mark.parametrize(
    ("command", "error", "sentence"),
    [
        ({"command_wheel_torque": np.zeros((1, 2))}, CommandError, r"shape \(1, 2\).*\(1, 3\)"),
        (
            {"command_wheel_torque": [[0.0] * 3]},
            CommandError,
            "type list; .* float64 array",
        ),
        ({"command_wheel_torque": np.zeros((1, 3), complex)}, CommandError, "type complex128; "),
        ({"command_dipole": np.zeros((1, 3))}, UnknownName, "no command channel.*command_dipole"),
    ],
)
def test_a_command_the_machine_cannot_take_is_refused(sads, command, error, sentence):
    plant = SimulatedPlant(sads)
    plant.read(0.0)
    with pytest.raises(error, match=sentence):
        plant.write(command)


def test_time_does_not_run_backwards(sads):
    plant = SimulatedPlant(sads)
    plant.read(1.0)
    with pytest.raises(UsageError, match="time runs forward"):
        plant.read(0.5)


def test_a_lower_stage_that_turns_alone_shows_its_heading():
    run = fly("astros:mode_a", "thruster_pd", reference="hold:0,0,20", duration=40.0)
    heading = run.recording["truth_heading"].value[:, 0]
    assert np.degrees(heading[-1]) == pytest.approx(20.0, abs=1.0)
    w, _, _, z = run.recording["truth_attitude"].value.T
    np.testing.assert_allclose(heading, 2.0 * np.arctan2(z, w), atol=1e-12)
