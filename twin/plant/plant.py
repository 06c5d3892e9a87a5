"""The one interface between the loop and a machine, be it simulated, replayed or real."""

import abc
from types import TracebackType
from typing import Self

from twin.platform import Platform
from twin.signals import Command, Reading, Samples


class Plant(abc.ABC):
    """Simulated, replayed or real. The loop cannot tell which."""

    platform: Platform
    n: int
    """Runs in the batch; 1 on hardware."""
    stopped: dict[int, str]
    """Runs that have ended early, with the reason: row -> sentence."""
    safe_reason: str = ""
    """Why the machine was brought to its safe state, a sentence; empty while it was not."""

    @property
    def doubt(self) -> str:
        """Why what its streams say of one motion cannot all be true, now; empty: it can."""
        return ""

    def why_bad(self, stream: str) -> str:
        """Why the newest sample of a stream is not valid; empty: it is, or nobody knows."""
        del stream
        return ""

    @abc.abstractmethod
    def read(self, until: float) -> Reading:
        """All samples that arrived by `until` [s].

        A simulated plant advances to it under the held command; a real one waits for nothing.
        """

    @abc.abstractmethod
    def write(self, command: Command) -> Command:
        """Apply from now on; return what is really applied, after limits.

        A channel that is absent keeps its last command. A run whose command is not finite is
        stopped, with the reason in `stopped`.

        Raises:
            UnknownName: a channel the machine lacks.
            CommandError: an array of the wrong shape.
        """

    def engage(self) -> None:  # noqa: B027  (a simulated plant takes commands at once)
        """Let commands reach the actuators; who may ask for it, `twin.plant.guard` decides.

        Raises:
            DeviceError: a device refuses.
        """

    def disengage(self) -> None:  # noqa: B027
        """Take no command to the actuators from now on; what moves is safe already."""

    def safe_stop(self, rest: Command, *, floating: bool) -> None:
        """Bring what moves to rest at once.

        Args:
            rest: the command at which it rests; a plant without a way of its own is told just it.
            floating: nothing may lose its hold.
        """
        del floating
        self.write(rest)

    def truth(self) -> dict[str, Samples]:
        """A simulation's true states at the last `read`, as `truth_*` streams; else nothing."""
        return {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:  # noqa: B027  (a simulated plant has nothing to release)
        """Leave the machine safe and release it."""
