"""Command nothing: wheels coast, masses stay where they are, the body floats free."""

from dataclasses import dataclass

from twin.controller import Controller
from twin.platform import Platform
from twin.signals import Command, Estimate, Target


@dataclass(frozen=True)
class FreeFloat(Controller[None]):
    """No command on any channel; for free oscillation, drag and drift, and any platform."""

    def init(self, platform: Platform, n: int) -> None:
        """There is nothing to remember."""

    def update(
        self, state: None, estimate: Estimate, target: Target, time: float
    ) -> tuple[Command, None]:
        """No channel: each keeps the command it has, which is none."""
        return {}, None
