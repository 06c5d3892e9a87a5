"""Every machine for 300 s: what its own actuators cannot change, and what a swing keeps.

A machine with all its parts on an air bearing cannot change its momentum about the vertical, and
keeps its energy while nothing is commanded. The momentum is kept at the step that is named here.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import mujoco
import numpy as np
import pytest

from twin.plant.initial import InitialState
from twin.plant.simulated import SimulatedPlant
from twin.platform import Platform, load_platform
from twin.rotation import from_rotation_vector

SECONDS = 300.0
EVERY = 20
"""Ticks between two looks."""


@dataclass(frozen=True)
class Kept:
    """What is claimed of a machine."""

    step: float
    """[s] for the momentum"""
    momentum: float
    """Drift at that step, in parts of the largest momentum that any part holds."""
    energy: float
    """Drift at the machine's own step, in parts of the largest kinetic energy of its motion."""


MACHINES = {
    "sads": Kept(0.01, 1e-10, 4e-10),
    "cubesat": Kept(0.01, 1e-10, 4e-10),
    "tas2": Kept(0.01, 1e-10, 1e-9),
    "whorl1": Kept(0.005, 1e-10, 4e-10),
    "whorl2": Kept(0.005, 5e-11, 3e-10),
    "astros": Kept(0.01, 5e-11, 2e-10),
    "astros:mode_a": Kept(0.01, 3e-11, 2e-9),
    "astros:mode_c": Kept(0.01, 3e-11, 2e-10),
}


class Ledger:
    """Momentum and energy of a plant's state, by MuJoCo's own sums over bodies."""

    def __init__(self, plant: SimulatedPlant) -> None:
        self.machine, self._plant = plant.machine, plant
        self._data = mujoco.MjData(self.machine.model)
        mujoco.mj_kinematics(self.machine.model, self._data)
        self._level = self._data.xmat[self.machine.base_body].reshape(3, 3).copy()

    def momentum(self) -> float:
        """About the room's vertical through the CR at its start, L_CM + M c x v [N m s].

        The bearing's force passes through that line while the CR stands. On a planar stage that
        floats nothing holds the whole but vertical forces, which turn nothing about a vertical.
        """
        model, data = self.machine.model, self._data
        (data.qpos[:],), (data.qvel[:],) = self._plant.state
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        carried = model.body_subtreemass[0] * np.cross(data.subtree_com[0], data.subtree_linvel[0])
        base = self.machine.platform.base
        lower = 0.0
        if base.joint in base.locked:
            # the lower stage turns with a ball that is locked to it, and is an armature of it
            about = self.machine.base_dof.start + 2
            lower = model.dof_armature[about] * data.qvel[about]
        return float((data.subtree_angmom[0] + carried)[2] + lower)

    def energy(self) -> tuple[float, float]:
        """Kinetic, and potential over that of a CM at the CR's height [J].

        Of wheels that spin freely and of rotors kept at their speed only what the body's rates
        make of them counts: what is kept then is Routh's and Jacobi's energy.
        """
        model, data = self.machine.model, self._data
        (data.qpos[:],), (data.qvel[:],) = self._plant.state
        data.qvel[self.machine.rotor_dof] = 0.0
        mujoco.mj_fwdPosition(model, data)
        spin, wheels = np.empty(model.nv), self.machine.wheel_dof
        mujoco.mj_mulM(model, data, spin, data.qvel)
        data.qvel[wheels] -= spin[wheels] / model.dof_M0[wheels]
        mujoco.mj_energyVel(model, data)
        platform = self.machine.platform
        turned = data.xmat[self.machine.base_body].reshape(3, 3) @ self._level.T
        return data.energy[1], platform.gravity * (turned @ platform.center_of_mass_offset)[2]


def hanging(name: str, depth: float) -> Platform:
    """With its CM `depth` [m] below the CR and a little beside: it swings clear of its stop."""
    platform = load_platform(name)
    offset = platform.mass * np.array([0.01, -0.01, -1.0]) * depth
    wanted = ("gyro", "stage_position") if platform.effects else ()  # by stages that shake
    sensors = {name: platform.sensors[name] for name in wanted}
    return replace(platform, center_of_mass_offset=offset, sensors=sensors)


def internal_commands(platform: Platform, time: float) -> dict[str, np.ndarray]:
    """Slow waves on all that exchanges momentum within the machine, and on coils along z.

    Torques and rates are cosines, so that what they move swings about its start.
    """

    def phases(count: int) -> np.ndarray:
        return time * (0.5 - 0.1 * np.arange(count) / max(count, 1))[None]

    wheels, stages, gimbals = platform.wheels, platform.stages, platform.gimbals
    inertia = np.linalg.eigvalsh(platform.inertia)[0]
    commands = {
        # 1 cm moves the CM by far more than its offset, so a share of the weight's moment is taken
        "command_stage_position": np.sin(phases(len(stages)))
        * np.array([min(0.2 * s.travel[1], 1e-5 * platform.mass / s.mass) for s in stages]),
        "command_wheel_torque": np.cos(phases(len(wheels)))
        * np.array([min(0.02 * w.torque_limit, 1e-3 * inertia) for w in wheels]),
        "command_gimbal_rate": np.cos(phases(len(gimbals)))
        * np.array([0.05 * g.rate for g in gimbals]),
        "command_dipole": 0.1 * np.sin(phases(3)),
    }
    return {name: value for name, value in commands.items() if name in platform.commands}


def watch(plant: SimulatedPlant, look: Callable[[], None], *, quiet: bool) -> None:
    """Fly for SECONDS clear of the stop, with a look now and then."""
    platform, lean = plant.platform, 0.0
    # where nothing is commanded, nothing happens at most ticks
    for k in range(0, round(SECONDS / platform.tick) + 1, EVERY // 4 if quiet else 1):
        plant.read(k * platform.tick)
        if k % EVERY == 0:
            look()
            if platform.base.kind == "ball":
                attitude = plant.state[0][:, plant.machine.base_qpos]
                lean = max(lean, float(platform.lean(attitude)[0]))
        if not quiet:
            plant.write(internal_commands(platform, k * platform.tick))
    assert not plant.stopped
    assert lean < platform.stop_angle, "what the stop takes is not kept"


def momentum_drift(platform: Platform) -> float:
    """Under internal commands, in parts of the largest momentum that any part holds."""
    swing = min(0.01, 0.01 * platform.stop_angle)
    held = platform.base.joint in platform.base.locked
    rate = np.array([0.0 if held else swing, 0.0 if held else -swing, 0.03])
    plant = SimulatedPlant(platform, initial=InitialState(rate_body=rate))
    ledger, machine = Ledger(plant), plant.machine
    wheels = np.array([wheel.inertia for wheel in platform.wheels])
    seen: list[float] = []
    largest = max((abs(rotor.momentum) for rotor in platform.rotors), default=0.0)

    def look() -> None:
        nonlocal largest
        seen.append(ledger.momentum())
        rates = plant.state[1][0]
        turning = float(np.linalg.norm(platform.inertia @ rates[machine.base_dof]))
        largest = max(largest, turning, *np.abs(rates[machine.wheel_dof] * wheels))

    watch(plant, look, quiet=False)
    drift = float(np.abs(np.array(seen) - seen[0]).max()) / largest
    print(f"{platform.name} at {platform.step:g} s: {drift:.1e} of {largest:.3g} N m s kept")
    return drift


def energy_drift(platform: Platform, initial: InitialState) -> float:
    """With nothing commanded, in parts of the largest kinetic energy of the body's motion."""
    plant = SimulatedPlant(platform, initial=initial)
    ledger, seen = Ledger(plant), []
    watch(plant, lambda: seen.append(ledger.energy()), quiet=True)
    kinetic, potential = np.array(seen).T
    energy = kinetic + potential
    drift = float(np.abs(energy - energy[0]).max() / kinetic.max())
    print(
        f"{platform.name} at {platform.step:g} s: energy to {drift:.1e} of {kinetic.max():.3g} J, "
        f"{np.ptp(potential):.3g} J of it exchanged"
    )
    return drift


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=pytest.mark.slow) if "whorl" in name else name for name in MACHINES],
)
def test_momentum_about_the_vertical_is_kept_by_all_that_acts_within(name: str, agrees):
    """Coils in a vertical field change none of it either."""
    kept, platform = MACHINES[name], hanging(name, 5e-5)
    drift = momentum_drift(replace(platform, step=kept.step))
    what = f"{name}: momentum about the vertical over {SECONDS:g} s"
    agrees(what, drift, kept.momentum, "of the largest momentum")


@pytest.mark.parametrize("name", MACHINES)
def test_energy_of_a_machine_left_alone_is_kept(name: str, agrees):
    """It swings below its CR with wheels free, gyros spinning and all else at rest."""
    kept, platform = MACHINES[name], hanging(name, 3e-4)
    lean = min(np.radians(5.0), 0.5 * platform.stop_angle)
    held = platform.base.joint in platform.base.locked
    start = InitialState(
        attitude=from_rotation_vector((0.0 if held else lean) * np.array([0.8, 0.6, 0.0])),
        rate_body=np.array([0.0, 0.0, 0.02]),
        velocity=np.array([1e-3, -2e-3, 0.0]) if platform.base.travels else np.zeros(3),
    )
    drift = energy_drift(platform, start)
    agrees(f"{name}: energy over {SECONDS:g} s", drift, kept.energy, "of the motion's")
