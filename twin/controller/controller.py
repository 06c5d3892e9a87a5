"""What a control law is: a frozen dataclass of gains with `init` and `update`."""

import abc
from collections.abc import Mapping
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from twin.platform import Platform
from twin.signals import Command, Estimate, Target

State = TypeVar("State")


class Controller(abc.ABC, Generic[State]):
    """A control law: a frozen dataclass whose fields are its gains.

    It only controls: what it remembers travels in `state`, so that the same object serves one run
    or a thousand, live or replayed. Every array has the batch axis first. Fields carry their unit:
    `proportional: float = field(default=5.0, metadata={"unit": "N m"})`, with a docstring below.
    """

    reference: ClassVar[str] = "hold"
    """What it follows unless told otherwise; see `twin.reference.parse_reference`."""

    @abc.abstractmethod
    def init(self, platform: Platform, n: int) -> State:
        """State before the first tick, for n runs.

        Raises:
            ControllerError: the law cannot drive this platform; says what it lacks.
        """

    @abc.abstractmethod
    def update(
        self, state: State, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, State]:
        """Command to hold until the next tick, and the state after it."""

    def message(
        self, state: State, estimate: Estimate, time: float
    ) -> Mapping[str, NDArray[np.float64]]:
        """What it sends to the other machines of a run beside the estimate, (n, k) each, by name;
        asked before `update`, at each tick at which the radio sends."""
        return {}

    def first_command(self, platform: Platform, estimate: Estimate, target: Target) -> Command:
        """What it says at time 0: asked before anything moves, for which actuators it uses."""
        state = self.init(platform, len(estimate.valid))
        command, _ = self.update(state, estimate, target, 0.0)
        return command

    def close(self) -> None:
        """The run is over."""
        return

    def lost(self, state: State) -> str:
        """Why it cannot go on, a sentence; empty while it can."""
        return ""

    def finished(self, state: State) -> NDArray[np.bool_] | None:
        """(n,) the runs that need no more ticks; None for a law, which has no end of its own."""
        return None


AnyController = Controller[Any]
