"""`twin doctor`: whether this computer is fit to fly a machine on its bench."""

from dataclasses import asdict, dataclass
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Doctor:
    """Look whether this computer is fit to fly a machine: ports, adapters, permissions, lateness.

    Tells whether each port of the machine is there and may be opened, how long USB adapters hold
    bytes back, whether a process may have a priority of its own, and how late ticks come. Nothing
    is opened, nothing is changed. Ends with 1 where something is bad, not where it is poor.
    """

    platform: Annotated[str | None, tyro.conf.Positional, tyro.conf.arg(metavar="[PLATFORM]")] = (
        None
    )
    """Whose ports are looked at; without one, only the computer is."""
    seconds: Annotated[float, tyro.conf.arg(metavar="SECONDS")] = 3.0
    """For which ticks are timed."""
    rate: Annotated[float, tyro.conf.arg(metavar="HZ")] = 50.0
    """At which they are."""
    json: bool = False
    """Print one JSON document instead of text."""

    def run(self) -> int:
        """Examine; the exit code."""
        import sys

        from twin.cli.output import print_json
        from twin.errors import UsageError
        from twin.platform import load_platform

        if not 0.0 < self.seconds <= 3600.0 or not 1.0 <= self.rate <= 1000.0:
            raise UsageError(
                f"--seconds {self.seconds:g} --rate {self.rate:g}; give up to an hour, at 1 to "
                "1000 Hz"
            )
        if sys.platform == "win32":
            raise UsageError("twin doctor looks at Linux; on Windows look at the device manager")
        from twin.plant.hardware_setup import read_hardware
        from twin.service.doctor import Verdict, examine

        ports: dict[str, str] = {}
        if self.platform is not None:
            devices = read_hardware(load_platform(self.platform)).devices
            ports = {name: settings.port for name, settings in devices.items()}
        findings = examine(ports, seconds=self.seconds, rate=self.rate)
        if self.json:
            print_json([asdict(item) | {"verdict": item.verdict.value} for item in findings])
        else:
            for item in findings:
                print(f"{item.verdict.value:<5} {item.what}: {item.sentence}")
        return 1 if any(item.verdict is Verdict.bad for item in findings) else 0
