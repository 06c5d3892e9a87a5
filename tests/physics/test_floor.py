"""A machine on a floor, simulated and predicted, against its equations of motion integrated alone.

    m x" - S_y h" - S_x h'^2 = F_x - c x' + m g s_x
    m y" + S_x h" - S_y h'^2 = F_y - c y' + m g s_y
    J h" + S_x y" - S_y x"  = T - d h' + g (S_x s_y - S_y s_x)

with S the mass moment turned by the heading h; by another integrator, and no MuJoCo.
"""

from dataclasses import replace
from itertools import pairwise

import mujoco
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from twin.effects import parse_effects, with_effects
from twin.model import Machine
from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform, on_floor
from twin.predict.base import base_parameters
from twin.predict.body import Body, body_of
from twin.predict.forces import predicted_machine
from twin.predict.innovations import Problem
from twin.predict.logs import motion_of
from twin.predict.response import mass_matrix
from twin.predict.states import STEP, States, carried_states
from twin.recording import Recording, Series

TICK = 0.06
SLOPE = np.array([3e-4, -2e-4])
DRAG = np.array([1.8, 1.8, 0.3])
"""Of the platform's MJCF [N s/m, N s/m, N m s]."""


@pytest.fixture(scope="module")
def platform() -> Platform:
    """Its thrusters late by no whole number of steps, one of them less than the others."""
    stated = load_platform("kentucky_planar")
    late = [replace(item, delay=0.047) for item in stated.thrusters]
    late[2] = replace(late[2], delay=0.013)
    effects = parse_effects(f"floor_slope={SLOPE[0]}/{SLOPE[1]}")
    return with_effects(replace(stated, thrusters=tuple(late)), effects)


def commands(seed: int, ticks: int) -> np.ndarray:
    """(ticks, 8) valves that open at random, three ticks at a time; all shut at first."""
    rng = np.random.default_rng(seed)
    valves = np.repeat(rng.random((ticks // 3 + 1, 8)) < 0.4, 3, axis=0)[:ticks]
    valves[:3] = False
    return valves


def forces_of(platform: Platform, valves: np.ndarray) -> np.ndarray:
    return valves * np.array([item.force_limit for item in platform.thrusters])


def integrated(platform: Platform, force: np.ndarray, start: np.ndarray, times: np.ndarray):
    """(m, 6) x, y, h and their rates at some times, by DOP853 from switch to switch."""
    mass, moment, inertia = (
        platform.mass,
        platform.center_of_mass_offset,
        platform.inertia[2, 2],
    )
    along = np.array([item.direction[:2] for item in platform.thrusters])
    arm = np.array([np.cross(item.point, item.direction)[2] for item in platform.thrusters])
    delay = np.array([item.delay for item in platform.thrusters])
    pull = platform.gravity * SLOPE
    end = times[-1]
    switches = np.unique(
        np.concatenate([[0.0, end], *(TICK * np.arange(len(force)) + d for d in delay)])
    )
    switches = switches[switches <= end]

    def pushed(time: float) -> np.ndarray:
        tick = np.floor((time - delay) / TICK + 1e-9).astype(int)
        held = np.where(tick >= 0, tick, 0).clip(max=len(force) - 1)
        return np.where(tick >= 0, force[held, np.arange(8)], 0.0)

    def slope(state: np.ndarray, push: np.ndarray) -> np.ndarray:
        cosine, sine = np.cos(state[2]), np.sin(state[2])
        turn = np.array([[cosine, -sine], [sine, cosine]])
        s = turn @ moment[:2]
        rate = state[3:]
        matrix = np.array([[mass, 0, -s[1]], [0, mass, s[0]], [-s[1], s[0], inertia]])
        right = np.concatenate([turn @ (push @ along) + mass * pull, [push @ arm]])
        right[2] += s[0] * pull[1] - s[1] * pull[0]
        right[:2] += s * rate[2] ** 2
        return np.concatenate([rate, np.linalg.solve(matrix, right - DRAG * rate)])

    known, state = [start], start
    for begin, stop in pairwise(switches):
        push = pushed(0.5 * (begin + stop))
        wanted = times[(times > begin + 1e-12) & (times <= stop + 1e-12)]
        told = solve_ivp(
            lambda _, y, push=push: slope(y, push),
            (begin, stop),
            state,
            "DOP853",
            t_eval=np.unique(np.append(wanted, stop)).clip(begin, stop),
            rtol=1e-11,
            atol=1e-13,
        )
        known += list(told.y.T[: len(wanted)])
        state = told.y[:, -1]
    return np.array(known)


START = np.array([0.1, -0.2, 0.7, 0.03, -0.02, 0.2])


def test_a_simulated_machine_on_a_floor_follows_its_equations_of_motion(
    platform: Platform, agrees, drawn_seed: int
):
    valves = commands(drawn_seed, 200)
    initial = InitialState(
        attitude=np.array([np.cos(0.35), 0.0, 0.0, np.sin(0.35)]),
        rate_body=np.array([0.0, 0.0, START[5]]),
        velocity=np.array([START[3], START[4], 0.0]),
    )
    plant = SimulatedPlant(platform, initial=initial)
    for tick, open_ in enumerate(forces_of(platform, valves)):
        plant.write({"command_thruster": open_[None]})
        plant.read(until=TICK * (tick + 1))
    qpos, qvel = plant.state
    machine = plant.machine
    heading = 2.0 * np.arctan2(qpos[0, machine.base_qpos][3], qpos[0, machine.base_qpos][0])
    start = np.concatenate([[0.0, 0.0], START[2:]])
    true = integrated(platform, forces_of(platform, valves), start, np.array([0.0, 200 * TICK]))[-1]
    place = np.linalg.norm(qpos[0, machine.place_qpos] - true[:2])
    turned = abs(np.angle(np.exp(1j * (heading - true[2]))))
    # a step in which a valve switches gets the mean force, exact to the second order: over 200
    # ticks these errors add up like noise, to at most 3.4e-6 rad in 80 draws
    agrees("kentucky_planar: place after 12 s", place, 3e-6, "m")
    agrees("kentucky_planar: heading after 12 s", turned, 6e-6, "rad")
    assert np.abs(qvel[0, machine.place_dof] - true[3:5]).max() < 1e-5


@pytest.fixture(scope="module")
def predicted(platform: Platform) -> tuple[Body, Machine, np.ndarray]:
    """A log of 30 s without noise, of a motion that was integrated; and the forces commanded."""
    valves = commands(11, 500)
    force = forces_of(platform, valves)
    times = TICK * np.arange(500)
    true = integrated(platform, force, START, times)
    half = 0.5 * true[:, 2]
    attitude = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1)
    names = tuple(item.name for item in platform.thrusters)
    log = Recording(
        {
            "position": Series(times, true[:, :2], ("x", "y"), "m"),
            "attitude": Series(times, attitude, ("w", "x", "y", "z"), "1"),
            "command_thruster": Series(times, force, names, "N"),
        },
        {"streams": {"position": {"noise": 1e-6}, "attitude": {"noise": 1e-6}}},
    )
    machine = predicted_machine(on_floor(platform))
    return body_of(machine, log, motion_of(log, machine.platform)), machine, force


def test_a_prediction_of_a_machine_on_a_floor_follows_its_equations_of_motion(
    predicted: tuple[Body, Machine, np.ndarray], agrees
):
    body, machine, force = predicted
    grid = body.grid
    times = grid.begin + grid.length * np.arange(grid.segments)
    true = integrated(machine.platform, force, START, times)
    ends = true[1:]
    none = np.zeros((len(true), 0))
    start = States(true[:, :3], true[:, 3:], none, none)
    path = body.rollouts.paths(machine.model, start.batched())
    count = len(ends)
    place = np.linalg.norm(path.position[0, :count, -1, :2] - ends[:, :2], axis=1).max()
    agrees("prediction on a floor: place after 10 s", float(place), 5e-6, "m")
    turned = float(np.abs(path.position[0, :count, -1, 2] - ends[:, 2]).max())
    agrees("prediction on a floor: heading after 10 s", turned, 1e-5, "rad")


def test_the_neighbours_of_a_path_on_a_floor_follow_from_its_equations(
    predicted: tuple[Body, Machine, np.ndarray],
):
    body, machine, _ = predicted
    paths, carried = body.rollouts.around(machine.model, body.start)
    x = body.start.width
    shifts = np.concatenate([np.zeros((1, x)), STEP * np.eye(x)])[:, None, :]
    rolled = body.rollouts.paths(machine.model, body.start.batched().moved(shifts))
    differenced = carried_states(np.moveaxis(rolled[1:].less(rolled[:1]), 0, -1) / STEP)
    assert np.abs(carried - differenced).max() < 5e-6
    assert np.abs(paths.position[0] - rolled.position[0]).max() == 0.0


def test_the_columns_of_mass_inertia_and_mass_moment_are_derivatives_of_the_prediction(
    predicted: tuple[Body, Machine, np.ndarray],
):
    body, machine, _ = predicted
    base = base_parameters(machine)
    assert base.names == ("mass", "Jzz", "mr_x", "mr_y")
    problem = Problem([body], base)
    at = problem.start(base.as_stated, [np.zeros(0)])
    columns = problem.exact(at)[0].linear.shared
    for i, scale in enumerate(base.scale):
        ends = []
        for sign in (1.0, -1.0):
            theta = base.as_stated.copy()
            theta[i] += sign * 1e-3 * scale
            ends.append(problem.exact(replace(at, theta=theta))[0].linear.residual)
        numeric = (ends[0] - ends[1]) / (2e-3 * scale)
        error = np.linalg.norm(columns[..., i] - numeric) / np.linalg.norm(numeric)
        assert error < 2e-3, base.names[i]


def test_a_locked_ball_on_a_stage_carries_the_inertia_of_both_and_its_gyros():
    stated = load_platform("astros:mode_a")
    machine = predicted_machine(on_floor(stated))
    assert (machine.base_dof.start, machine.base_dof.stop) == (0, 3)
    whole = mass_matrix(machine.model, mujoco.MjData(machine.model), machine.model.qpos0)
    upper, lower = stated.inertia[2, 2], 4.0  # [kg m^2] of the stage, as its MJCF has it
    assert whole[2, 2] == pytest.approx(upper + lower, rel=1e-6)
    assert whole[0, 0] == pytest.approx(stated.mass + 15.0 + 45.0, rel=1e-9)
