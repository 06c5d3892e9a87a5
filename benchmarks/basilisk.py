"""The peer at n = 1: a hub with three wheels and an attitude law, all of it Basilisk's own code.

Basilisk's hub is free and feels no gravity, so it computes neither the pivot nor the CM's torque.
"""

# Basilisk comes with an extra
# pyright: reportMissingImports=false

from collections.abc import Callable

import numpy as np
from Basilisk.architecture import messaging
from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback, rwMotorTorque
from Basilisk.simulation import reactionWheelStateEffector, simpleNav, spacecraft, svIntegrators
from Basilisk.utilities import SimulationBaseClass, macros, simIncludeRW
from numpy.typing import NDArray

from twin.platform import Platform

Array = NDArray[np.float64]


class Spacecraft:
    """A machine with the platform's inertia and wheels, integrated by RK4."""

    def __init__(self, platform: Platform, step: float, rate_body: Array, speed: Array) -> None:
        """Put it together.

        Args:
            platform: gives inertia, wheels and control rate.
            step: of the dynamics [s]; divides the control period.
            rate_body: at the start, (3,) [rad/s].
            speed: of the wheels at the start, (3,) [rad/s].
        """
        self._simulation = SimulationBaseClass.SimBaseClass()
        self._parts: list[object] = []
        self._platform = platform
        process = self._simulation.CreateNewProcess("all", 10)
        for task, period in (("dynamics", step), ("flight", platform.tick)):
            process.addTask(self._simulation.CreateNewTask(task, macros.sec2nano(period)))
        self._hub = self._new_hub(rate_body)
        self._wheels = simIncludeRW.rwFactory()
        for wheel, start in zip(platform.wheels, speed, strict=True):
            self._wheels.create(
                "custom",
                wheel.axis.tolist(),
                Js=wheel.inertia,
                Omega=float(start) / macros.RPM,
                Omega_max=wheel.speed_limit / macros.RPM,
                u_max=wheel.torque_limit,
            )
        self._effector = reactionWheelStateEffector.ReactionWheelStateEffector()
        self._wheels.addToSpacecraft("wheels", self._effector, self._hub)
        self._add("dynamics", self._effector, priority=2)
        self._add("dynamics", self._hub, priority=1)

    def close_loop(self, proportional: float, derivative: float) -> None:
        """Hold the room's axes: MRP feedback at the control rate, on the true state.

        Args:
            proportional: torque per MRP, a quarter of the error angle [N m].
            derivative: torque per rate [N m s].
        """
        sensor = simpleNav.SimpleNav()
        sensor.scStateInMsg.subscribeTo(self._hub.scStateOutMsg)
        reference = inertial3D.inertial3D()
        reference.sigma_R0N = [0.0, 0.0, 0.0]
        error = attTrackingError.attTrackingError()
        error.attNavInMsg.subscribeTo(sensor.attOutMsg)
        error.attRefInMsg.subscribeTo(reference.attRefOutMsg)
        body = messaging.VehicleConfigMsg().write(
            messaging.VehicleConfigMsgPayload(ISCPntB_B=self._platform.inertia.ravel().tolist())
        )
        wheels = self._wheels.getConfigMessage()
        law = mrpFeedback.mrpFeedback()
        law.K, law.P, law.Ki = proportional, derivative, -1.0  # negative: no integral
        law.guidInMsg.subscribeTo(error.attGuidOutMsg)
        law.vehConfigInMsg.subscribeTo(body)
        law.rwParamsInMsg.subscribeTo(wheels)
        law.rwSpeedsInMsg.subscribeTo(self._effector.rwSpeedOutMsg)
        share = rwMotorTorque.rwMotorTorque()
        share.controlAxes_B = np.eye(3).ravel().tolist()
        share.vehControlInMsg.subscribeTo(law.cmdTorqueOutMsg)
        share.rwParamsInMsg.subscribeTo(wheels)
        self._effector.rwMotorCmdInMsg.subscribeTo(share.rwMotorTorqueOutMsg)
        self._parts += [body, wheels]
        for module in (sensor, reference, error, law, share):
            self._add("flight", module)

    def take_torques(self) -> Callable[[Array], None]:
        """What sets the torques (wheels,) of its motors [N m], held until the next."""
        message = messaging.ArrayMotorTorqueMsg()
        self._effector.rwMotorCmdInMsg.subscribeTo(message)
        self._parts.append(message)

        def take(torque: Array) -> None:
            payload = messaging.ArrayMotorTorqueMsgPayload(motorTorque=torque.tolist())
            message.write(payload, self._simulation.TotalSim.CurrentNanos)

        return take

    def ready(self) -> Callable[[float], None]:
        """What runs it for a number of seconds."""
        self._simulation.InitializeSimulation()

        def run(duration: float) -> None:
            self._simulation.ConfigureStopTime(macros.sec2nano(duration))
            self._simulation.ExecuteSimulation()

        return run

    @property
    def attitude(self) -> Array:
        """(4,) world from body."""
        sigma = np.array(self._hub.scStateOutMsg.read().sigma_BN)
        square = sigma @ sigma
        return np.array([1.0 - square, *(2.0 * sigma)]) / (1.0 + square)

    def _new_hub(self, rate_body: Array) -> spacecraft.Spacecraft:
        hub = spacecraft.Spacecraft()
        hub.hub.mHub = self._platform.mass
        hub.hub.r_BcB_B = [[0.0], [0.0], [0.0]]
        # with its wheels locked, as ours is stated
        hub.hub.IHubPntBc_B = self._platform.inertia.tolist()
        hub.hub.omega_BN_BInit = rate_body[:, None].tolist()
        integrator = svIntegrators.svIntegratorRK4(hub)
        hub.setIntegrator(integrator)
        self._parts.append(integrator)
        return hub

    def _add(self, task: str, module: object, priority: int = -1) -> None:
        self._parts.append(module)
        self._simulation.AddModelToTask(task, module, priority)
