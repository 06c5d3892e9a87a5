"""Runs of one batch whose effects have values of their own."""

from dataclasses import replace

import numpy as np
import pytest

from twin.effects import Effect, EffectError, catalogue, with_effects
from twin.plant.each import cannot_differ
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform

STREAMS = {"sensor_lag": "gyro", "clock_lag": "gyro", "clock_drift": "gyro"}
LATE = {"sensor_lag", "clock_lag", "clock_drift", "thruster_delay", "joint_torque_delay"}
ALIKE = {*LATE, "thruster_misalignment"}
"""Effects whose values are those of all runs."""
MACHINES = ("sads", "cubesat", "tas2", "astros", "dfki_pendulum", "kentucky_planar")


def machine_for(effect: Effect) -> Platform:
    """The first machine that can have it, in a field and with steps as short as it may need."""
    field = np.array([2.2e-5, 0.0, -4.2e-5])
    for name in MACHINES:
        plain = load_platform(name)
        changed = replace(plain, magnetic_field=field, effects=(), step=plain.step / 16)
        if not effect.unfit(changed):
            return changed
    raise AssertionError(f"no machine can have {effect.label}")


def sizes(kind: type[Effect], count: int) -> list[Effect]:
    """The effect at as many sizes."""
    typical = kind.typical(STREAMS.get(kind.name, ""))
    low, high = kind.bounds()
    return [
        typical.with_values(np.clip(size * typical.values, low, high))
        for size in np.linspace(0.3, 1.1, count)
    ]


def moved(plant: SimulatedPlant, runs: tuple[int, ...]) -> list[dict[str, np.ndarray]]:
    """What is shown and true, under commands that differ from run to run."""
    seen = []
    for tick in range(6):
        reading = plant.read(tick * plant.platform.tick)
        streams = {name: samples.value for name, samples in reading.streams.items()}
        seen.append(streams | {name: samples.value for name, samples in plant.truth().items()})
        wave = np.sin(0.9 * tick + np.array(runs))[:, None]
        limits = {"command_stage_position": 1e-3, "command_gimbal_rate": 0.1}
        plant.write(
            {
                name: limits.get(name, 0.01) * wave * np.ones(width)
                for name, width in plant.platform.commands.items()
                if name != "command_thruster"
            }
        )
    return seen


@pytest.mark.parametrize("kind", catalogue(), ids=lambda kind: kind.name)
def test_a_run_among_others_is_bit_for_bit_that_of_its_own_machine(kind: type[Effect]):
    if kind.name in ALIKE:
        return
    effects = sizes(kind, 3)
    platform = machine_for(effects[0])
    # the pads of a machine on a floor hold it level
    floor = platform.base.joint in platform.base.locked
    rate, velocity = (
        ([0.0, 0.0, 0.04], [0.02, -0.01, 0.0]) if floor else ([0.03, -0.05, 0.04], [0.0] * 3)
    )
    start = InitialState(rate_body=np.array(rate), velocity=np.array(velocity))
    nominal = with_effects(platform, [effects[1]])
    runs = (4, 5, 6)
    each = [(effect,) for effect in effects]
    together = SimulatedPlant(nominal, runs=runs, seed=3, initial=start, effects=each)
    batch = moved(together, runs)
    for row, (run, effect) in enumerate(zip(runs, effects, strict=True)):
        own = with_effects(platform, [effect])
        alone = moved(SimulatedPlant(own, runs=(run, run), seed=3, initial=start), (run, run))
        for streams, again in zip(batch, alone, strict=True):
            for name, value in streams.items():
                assert np.array_equal(value[row], again[name][0]), (name, effect.label)
    different = any(not np.array_equal(streams[n][0], streams[n][1]) for streams in batch[1:]
                    for n in streams)  # fmt: skip
    assert different, "all runs had one value"


@pytest.mark.parametrize("name", sorted(ALIKE))
def test_an_effect_of_all_runs_is_refused_with_values_of_their_own(name: str):
    kind = next(kind for kind in catalogue() if kind.name == name)
    effects = sizes(kind, 2)
    platform = load_platform("astros") if "thruster" in name else machine_for(effects[0])
    nominal = with_effects(replace(platform, effects=()), [effects[0]])
    assert cannot_differ(effects[0], nominal)
    with pytest.raises(EffectError, match="give it one value"):
        SimulatedPlant(nominal, runs=(0, 1), effects=[(effect,) for effect in effects])
    SimulatedPlant(nominal, runs=(0, 1), effects=[(effects[0],)] * 2)


def test_offsets_of_runs_go_with_effects_of_runs():
    platform = load_platform("sads")
    kind = next(kind for kind in catalogue() if kind.name == "bearing_viscous_friction")
    effects = sizes(kind, 2)
    offsets = np.array([[1e-3, 0.0, -2e-2], [0.0, 2e-3, -1e-2]])
    start = InitialState(center_of_mass_offset=offsets)
    plant = SimulatedPlant(
        with_effects(platform, [effects[0]]),
        runs=(0, 1),
        initial=start,
        effects=[(effect,) for effect in effects],
    )
    plant.read(1.0)
    own = replace(with_effects(platform, [effects[1]]), center_of_mass_offset=offsets[1])
    alone = SimulatedPlant(own, runs=(1, 1))
    alone.read(1.0)
    assert np.array_equal(plant.state[0][1], alone.state[0][0])
    true = plant.truth()["truth_center_of_mass_offset"].value[:, 0]
    np.testing.assert_allclose(true, offsets, atol=1e-12)
