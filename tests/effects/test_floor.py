"""Effects of floor, pads and thrusters on a machine that glides: closed forms, and found blind.

`pytest -m slow tests/effects/test_floor.py -s` prints truth, estimate and interval of each.
"""

from dataclasses import replace

import numpy as np
import pytest

from twin.api import fly
from twin.diagnosis import diagnose
from twin.effects import EffectError, parse_effects, with_effects
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.recording import Recording

TICK = 0.06
GLIDE = "pad_viscous_friction=-1.8/-0.3"
"""Takes away the drag that the MJCF states."""
HIDDEN = {
    "floor_slope": "floor_slope=1e-4/-6e-5",
    "pad_viscous_friction": "pad_viscous_friction=-0.9/0.05",
    "pad_coulomb_friction": "pad_coulomb_friction=0.008/0.001",
    "thruster_delay": "thruster_delay=0.033",
    "thruster_gain": "thruster_gain=-0.07",
    "nozzle_gain": "nozzle_gain:t2=-1",
}
QUICK = ("thruster_delay",)


@pytest.fixture(scope="module")
def symmetric() -> Platform:
    """Its centre of mass in the middle, so that what pushes it there does not turn it."""
    return replace(load_platform("kentucky_planar"), center_of_mass_offset=np.zeros(3))


def glided(
    platform: Platform, effects: str, seconds: float, velocity: tuple[float, float], turn: float
) -> tuple[np.ndarray, np.ndarray]:
    """Position and rate (x, y, heading) after some time without a command."""
    platform = with_effects(platform, parse_effects(effects))
    initial = InitialState(
        velocity=np.array([*velocity, 0.0]), rate_body=np.array([0.0, 0.0, turn])
    )
    return _after(platform, initial, [np.zeros(8)] * round(seconds / TICK))


def _after(
    platform: Platform, initial: InitialState, forces: list[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    plant = SimulatedPlant(platform, initial=initial)
    for tick, force in enumerate(forces):
        plant.write({"command_thruster": force[None]})
        plant.read(until=TICK * (tick + 1))
    qpos, qvel = (item[0] for item in plant.state)
    machine = plant.machine
    attitude = qpos[machine.base_qpos]
    heading = 2.0 * np.arctan2(attitude[3], attitude[0])
    return (
        np.append(qpos[machine.place_qpos], heading),
        np.append(qvel[machine.place_dof], qvel[machine.base_dof][2]),
    )


def test_down_a_slope_a_machine_falls_freely(symmetric: Platform, agrees):
    place, rate = glided(symmetric, f"floor_slope=3e-4/-2e-4,{GLIDE}", 6.0, (0.0, 0.0), 0.0)
    fall = symmetric.gravity * np.array([3e-4, -2e-4, 0.0])
    agrees("floor_slope: place after a free fall", np.abs(place - 18.0 * fall).max(), 1e-12, "m")
    agrees("floor_slope: rate after it", np.abs(rate - 6.0 * fall).max(), 1e-12, "m/s")


def test_viscous_pads_brake_exponentially(symmetric: Platform, agrees):
    _, rate = glided(symmetric, "pad_viscous_friction=0.7/0.1", 6.0, (0.1, -0.05), 0.3)
    mass, inertia = symmetric.mass, symmetric.inertia[2, 2]
    braked = np.exp(-6.0 * np.array([2.5 / mass, 2.5 / mass, 0.4 / inertia]))
    off = rate / (np.array([0.1, -0.05, 0.3]) * braked) - 1.0
    agrees("pad_viscous_friction: rates that decay", np.abs(off).max(), 5e-7)


def test_pads_that_touch_brake_at_every_speed_alike_and_along_the_motion(
    symmetric: Platform, agrees
):
    effects = f"pad_coulomb_friction=0.05/0.002,{GLIDE}"
    _, rate = glided(symmetric, effects, 6.0, (0.03, 0.04), 0.2)
    speed = 0.05 - 6.0 * 0.05 / symmetric.mass
    turn = 0.2 - 6.0 * 0.002 / symmetric.inertia[2, 2]
    # it fades below 1 mm/s and 5 mrad/s, and so takes a little less at any speed
    off = rate / np.array([0.6 * speed, 0.8 * speed, turn]) - 1.0
    agrees("pad_coulomb_friction: rates that fall linearly", np.abs(off).max(), 9e-4)


def test_a_machine_that_pads_have_stopped_stays(symmetric: Platform):
    effects = f"pad_coulomb_friction=0.5/0.05,{GLIDE}"
    _, rate = glided(symmetric, effects, 12.0, (0.03, 0.04), 0.2)
    assert np.abs(rate).max() < 1e-6


@pytest.mark.parametrize(
    ("effects", "delay", "share"),
    [
        ("", 0.04, 1.0),
        ("thruster_delay=0.053", 0.093, 1.0),
        ("thruster_delay=-0.017", 0.023, 1.0),
        ("thruster_gain=-0.25", 0.04, 0.75),
        ("nozzle_gain:t5=-0.5,nozzle_gain:t6=-0.5", 0.04, 0.5),
        ("nozzle_gain:t5=-1,nozzle_gain:t6=-1", 0.04, 0.0),
    ],
)
def test_a_late_or_weak_pulse_moves_a_machine_as_its_impulse_and_its_time_say(
    symmetric: Platform, effects: str, delay: float, share: float, agrees
):
    platform = with_effects(symmetric, parse_effects(",".join(filter(None, (effects, GLIDE)))))
    limits = np.array([item.force_limit for item in platform.thrusters])
    both = np.isin([item.name for item in platform.thrusters], ("t5", "t6"))
    forces = [limits * both] * 10 + [np.zeros(8)] * 20
    place, rate = _after(platform, InitialState(), forces)
    pull = share * limits[both].sum() / platform.mass
    assert rate[0] == pytest.approx(0.6 * pull, rel=1e-6)
    # 0.6 s of acceleration, whose middle was so long ago; unlike thrusters turn it a little
    off = abs(place[0] - 0.6 * pull * (1.8 - delay - 0.3))
    agrees(
        f"{effects.partition(',')[0] or 'thrusters'}: place after a pulse",
        off,
        1.5e-8 if share else 1e-12,
        "m",
    )


def test_an_on_off_valve_is_open_or_shut_for_a_whole_tick(symmetric: Platform):
    plant = SimulatedPlant(symmetric)
    limits = np.array([item.force_limit for item in symmetric.thrusters])
    shares = np.array([0.0, 0.2, 0.49, 0.5, 0.7, 1.0, 3.0, -1.0])
    applied = plant.write({"command_thruster": (shares * limits)[None]})["command_thruster"]
    assert applied[0] == pytest.approx(limits * [0, 0, 0, 1, 1, 1, 1, 0])


def test_no_thruster_pushes_before_its_command(symmetric: Platform):
    plant = SimulatedPlant(with_effects(symmetric, parse_effects("thruster_delay=-0.05")))
    with pytest.raises(EffectError, match=r"would push 0\.01 s before their commands"):
        plant.write({"command_thruster": np.zeros((1, 8))})


def test_the_mass_takes_a_gain_of_all_thrusters_unless_it_is_known():
    stated = load_platform("kentucky_planar")
    (gain,) = parse_effects("thruster_gain=-0.1")
    assert "mass may take it" in gain.hidden_from(stated)
    assert not gain.hidden_from(replace(stated, mass_sd=0.05))


def test_what_needs_a_floor_is_refused_on_a_bearing():
    for effect, lacks in (("floor_slope", "glides"), ("pad_viscous_friction", "three degrees")):
        with pytest.raises(EffectError, match=lacks):
            with_effects(load_platform("sads"), parse_effects(effect))


def flown(platform: Platform, effects: str, seed: int) -> Recording:
    """40 s of doublets from a glide."""
    run = fly(
        platform,
        "thruster_doublets",
        duration=40.0,
        velocity=(0.02, 0.01, 0.0),
        effects=effects,
        seed=seed,
    )
    return run.recording.without_truth()


MISSED = {
    "floor_slope": "a force that wanders takes the place of a slope of 0.1 mrad",
    "pad_viscous_friction": "as a force along a known path its size is 3 % off; as one that answers"
    " to the path, the real mission is not explained any more",
}


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name,
            marks=[
                *([] if name in QUICK else [pytest.mark.slow]),
                *([pytest.mark.xfail(reason=MISSED[name])] if name in MISSED else []),
            ],
        )
        for name in HIDDEN
    ],
)
def test_a_hidden_effect_is_named_and_sized_blind(name: str, drawn_seed: int):
    platform = load_platform("kentucky_planar")
    if name == "thruster_gain":
        known = np.full(3, 0.02)
        platform = replace(platform, mass_sd=0.02, center_of_mass_offset_sd=known)
    (truth,) = parse_effects(HIDDEN[name])
    found = diagnose([flown(platform, HIDDEN[name], drawn_seed)], platform)
    print(name, found.verdict, [cause.effect.words() for cause in found.causes])
    assert found.verdict == "explained"
    (cause,) = found.causes
    assert cause.effect.label == truth.label
    error = np.abs(cause.effect.values - truth.values)
    assert np.all(error < 2.0 * np.asarray(cause.half_widths)), "sized wrongly"


def test_a_healthy_log_of_a_machine_on_a_floor_is_called_healthy(drawn_seed: int):
    platform = load_platform("kentucky_planar")
    found = diagnose([flown(platform, "", drawn_seed)], platform)
    assert found.verdict == "healthy"
    run = found.free_runs[10.0]
    assert run is not None
    assert run.places is not None
    assert run.places[1] < 1e-3


def test_a_floor_that_falls_by_a_milliradian_pulls_a_machine_that_also_turns():
    platform = replace(load_platform("astros:mode_c"), center_of_mass_offset=np.zeros(3))
    sloped = with_effects(platform, parse_effects("floor_slope=1e-3/-2e-3"))
    with SimulatedPlant(sloped) as plant:
        plant.read(10.0)
        truth = plant.truth()
    pulled = truth["truth_velocity"].value[0, 0] / 10.0
    np.testing.assert_allclose(pulled, [9.81e-3, -19.62e-3, 0.0], atol=1e-12)
    np.testing.assert_allclose(truth["truth_attitude"].value[0, 0], [1, 0, 0, 0], atol=1e-12)


def test_an_accelerometer_that_slides_down_a_slope_feels_nothing_along_it():
    platform = replace(load_platform("astros:mode_c"), center_of_mass_offset=np.zeros(3))
    quiet = replace(
        platform.sensors["accelerometer"], noise=np.zeros(3), bias=np.zeros(3), cutoff=np.inf
    )
    platform = replace(platform, sensors={"accelerometer": quiet})
    sloped = with_effects(platform, parse_effects("floor_slope=1e-3/-2e-3"))
    with SimulatedPlant(sloped) as plant:
        plant.read(0.0)
        felt = plant.read(1.0).streams["accelerometer"].value[0]
    np.testing.assert_allclose(felt, np.tile([0.0, 0.0, 9.81], (len(felt), 1)), atol=1e-9)
