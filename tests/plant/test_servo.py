"""The drive of a gimbal: how it settles, sticks and slips, and what friction costs it."""

import shutil
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.optimize import brentq

from twin.effects import parse_effects, with_effects
from twin.errors import PlatformError
from twin.library import find_model
from twin.model import compile_model
from twin.plant.servo import RateLoops, coasted
from twin.plant.simulated import SimulatedPlant
from twin.platform import load_platform
from twin.platform.parts import GimbalDrive

IDEAL = GimbalDrive(
    inertia=0.2,
    proportional=2.0,
    integral=20.0,
    rate=5000.0,
    torque_constant=1.0,
    current_limit=np.inf,
    voltage=np.inf,
    resistance=1.0,
    friction=0.0,
    static_friction=0.0,
    encoder=0.0,
)
STEP = 1e-3
AT_ONCE = np.array([np.inf])


def turned(drive: GimbalDrive, rate: float, seconds: float, load: float = 0.0) -> np.ndarray:
    """(m, 2) angle and rate at the end of each ms under a commanded rate, from rest."""
    loops = RateLoops((drive,), np.zeros((1, 1)), np.zeros((1, 1)))
    rows = []
    for _ in range(round(seconds / STEP)):
        loops.turn(np.array([[rate]]), np.array([[load]]), steps=1, step=STEP, acceleration=AT_ONCE)
        rows.append((loops.angle[0, 0], loops.rate[0, 0]))
    return np.array(rows)


def test_a_drive_settles_as_a_loop_of_second_order(agrees):
    """I s^2 + K_p s + K_i, with a zero: w / r = (K_p s + K_i) / (I s^2 + K_p s + K_i)."""
    time = STEP * np.arange(1, 1001)
    decay = 0.5 * IDEAL.proportional / IDEAL.inertia
    swing = np.sqrt(IDEAL.integral / IDEAL.inertia - decay**2)
    # r - w obeys the free equation from 1 with the slope -K_p / I
    error = np.exp(-decay * time) * (np.cos(swing * time) - decay / swing * np.sin(swing * time))
    found = turned(IDEAL, 1.0, 1.0)[:, 1]
    off = np.abs(found - (1.0 - error)).max()
    agrees("gimbal drive: rate after a step of the command", off, 5e-3, "of the step")


def test_a_drive_that_sticks_and_slips_does_so_at_the_period_of_the_closed_form(agrees):
    """The integral winds up at rest to the static friction, and unwinds against the lower one."""
    drive = replace(IDEAL, proportional=0.5, integral=5.0, friction=0.02, static_friction=0.03)
    rate, inertia = 0.002, drive.inertia
    # slipping, y = e - F_c / K_i obeys I y'' + K_p y' + K_i y = 0 from y', w = 0 at y' = r
    first = (drive.static_friction - drive.proportional * rate - drive.friction) / drive.integral
    decay = 0.5 * drive.proportional / inertia
    swing = np.sqrt(drive.integral / inertia - decay**2)
    other = (rate + decay * first) / swing

    def error(t: float) -> float:
        wave = first * np.cos(swing * t) + other * np.sin(swing * t)
        return float(np.exp(-decay * t) * wave)

    def speed(t: float) -> float:
        """w = r - y'."""
        wave = first * np.cos(swing * t) + other * np.sin(swing * t)
        change = swing * (other * np.cos(swing * t) - first * np.sin(swing * t))
        return float(rate - np.exp(-decay * t) * (change - decay * wave))

    slip = brentq(speed, 0.5 * np.pi / swing, 1.5 * np.pi / swing)
    stick = (first - error(slip)) / rate
    rows = turned(drive, rate, 3.5 * (slip + stick))
    starts = np.flatnonzero((rows[1:, 1] > 0.0) & (rows[:-1, 1] == 0.0)) * STEP
    period = np.diff(starts)[-2:].mean()
    off = abs(period / (slip + stick) - 1.0)
    agrees("gimbal drive: period at which it sticks and slips", off, 1e-3, "of the period")
    peak = max(speed(t) for t in np.linspace(0.0, slip, 500))
    off = abs(rows[len(rows) // 2 :, 1].max() / peak - 1.0)
    agrees("gimbal drive: fastest while it slips", off, 2e-3, "of the rate")


def test_a_part_that_friction_stops_stays_or_turns_back(drawn_seed):
    """Against ten thousand small steps of which each may stop it."""
    rng = np.random.default_rng(drawn_seed)
    rate, torque = rng.normal(size=(2, 64)), rng.normal(size=(1, 64))
    dry, static, inertia, time = 0.5, 0.7, 0.3, 1.0
    angle, after = coasted(
        np.zeros_like(rate), rate, torque, np.array(inertia), np.array(dry), np.array(static), time
    )
    h, a, w = time / 1e4, np.zeros_like(rate), rate.copy()
    for _ in range(10_000):
        sign = np.where(w == 0.0, np.sign(torque), np.sign(w))
        free = w + h * (torque - dry * sign) / inertia
        stops = (w != 0.0) & (free * w <= 0.0)
        held = (w == 0.0) & (np.abs(torque) <= static)
        new = np.where(stops | held, 0.0, free)
        a, w = a + 0.5 * h * (w + new), new
    assert np.abs(after - w).max() < 1e-3
    assert np.abs(angle - a).max() < 1e-3


def test_current_and_voltage_bound_torque_and_speed_and_nothing_winds_up(agrees):
    drive = replace(
        IDEAL, rate=1000.0, torque_constant=0.5, current_limit=2.0, voltage=3.0, resistance=0.5
    )
    rows = turned(drive, 100.0, 3.0)
    # 1 N m until the back voltage leaves less than 2 A: 3 V - 0.5 ohm 2 A = 2 V, at 4 rad/s
    linear = rows[:, 1] < 3.99
    time = STEP * np.arange(1, len(rows) + 1)
    off = np.abs(rows[linear, 1] - 5.0 * time[linear]).max()
    agrees("gimbal drive: rate at the current limit", off, 1e-11, "rad/s")
    assert rows[-1, 1] == pytest.approx(6.0, rel=1e-2)  # 3 V over 0.5 V s/rad
    loops = RateLoops((drive,), np.zeros((1, 1)), np.zeros((1, 1)))
    for target, seconds in ((100.0, 1.0), (1.0, 2.0)):
        for _ in range(round(seconds / STEP)):
            loops.turn(
                np.array([[target]]), np.zeros((1, 1)), steps=1, step=STEP, acceleration=AT_ONCE
            )
    assert loops.rate[0, 0] == pytest.approx(1.0, abs=1e-3)


def mean_loss(name: str, effects: str) -> float:
    """Torque of a gyro that its gimbal falls short by, in the mean of 4 s at 0.02 rad/s [N m]."""
    platform = with_effects(load_platform(name), parse_effects(effects) if effects else ())
    plant = SimulatedPlant(platform)
    angles = []
    for k in range(121):
        plant.read(k * platform.tick)
        angles.append(plant.truth()["truth_gimbal_angle"].value[0, 0, 0])
        plant.write({"command_gimbal_rate": np.full((1, 3), 0.02)})
    rate = (angles[-1] - angles[40]) / (80 * platform.tick)
    return abs(0.02 - rate) * platform.rotors[0].momentum


def test_friction_in_the_loop_costs_a_gyro_no_torque_in_the_mean():
    """The load of a body that turns ever faster costs some: its change over K_i."""
    assert mean_loss("tas2", "gimbal_friction=0.02") == pytest.approx(0.080, rel=1e-6)
    drives = mean_loss("tas2:drives", "")
    assert mean_loss("tas2:drives", "gimbal_friction=0.02") == pytest.approx(drives, abs=1e-3)
    assert drives < 0.02


def test_the_body_loads_a_gimbal_as_inverse_dynamics_has_it(agrees):
    """What holds a gimbal at rest while the body turns, by MuJoCo's own inverse dynamics."""
    platform = load_platform("tas2:drives")
    machine, rate = compile_model(platform), np.array([0.02, -0.03, 0.01])
    plant = SimulatedPlant(platform)
    data = mujoco.MjData(machine.model)
    qpos, qvel = plant.state
    qvel[:, machine.base_dof] = rate
    data.qpos[:], data.qvel[:] = qpos[0], qvel[0]
    mujoco.mj_inverse(machine.model, data)
    load = plant._joints._gyros.load(qpos, qvel)[0]
    off = np.abs(load + data.qfrc_inverse[machine.gimbal_dof]).max() / np.abs(load).max()
    # what is left is the gimbals' own gyroscopic torque, w against 200 rad/s
    agrees("gimbal drive: torque of the turning body", off, 3e-4)


def test_friction_of_a_batch_is_that_of_each_run():
    platform = with_effects(load_platform("tas2:drives"), parse_effects("gimbal_friction=0.02"))
    each = [
        [replace(e, torque=torque) if e.name == "gimbal_friction" else e for e in effects]
        for torque, effects in ((t, parse_effects("gimbal_friction=0.02")) for t in (0.01, 0.05))
    ]
    stated = replace(platform, effects=platform.effects[-1:])
    plant = SimulatedPlant(stated, runs=(0, 1), effects=each)
    assert np.allclose(plant._joints.loops.friction[:, 0], [0.03, 0.07])
    assert np.allclose(plant._joints.loops.static[:, 0], [0.04, 0.08])


@pytest.mark.parametrize(
    ("stated", "what"),
    [
        ("rate = 130.0", "130 Hz, 1.3 periods in a step of 0.01 s"),
        ("static_friction = -0.01", "static_friction"),
        ("inertia = 0.0", "inertia"),
        ("torqe = 1.0", "torqe"),
    ],
)
def test_a_drive_that_cannot_be_is_refused(tmp_path, stated, what):
    folder = tmp_path / "tas2"
    shutil.copytree(find_model("tas2")[0], folder)
    key = stated.split(" ")[0]
    kept = (folder / "platform.toml").read_text(encoding="utf-8").splitlines()
    table = kept.index("[variants.drives.gimbals.drive]")
    own = [i for i in range(table, table + 12) if kept[i].startswith(f"{key} ")]
    for i in own:
        del kept[i]
    kept.insert(table + 1, stated)
    (folder / "platform.toml").write_text("\n".join(kept) + "\n", encoding="utf-8")
    with pytest.raises(PlatformError, match="platform.toml") as refused:
        SimulatedPlant(load_platform(f"{folder}:drives"))
    assert what in str(refused.value)
