"""Frames that a program is known to write in, turned into ours: z up, x forward."""

import re

from twin.intake.streams import Proposal

_TURNED = {
    "down": (("", 0), ("-", 1), ("-", 2)),
    "y up": (("", 0), ("-", 2), ("", 1)),
}
"""Which column, and with which sign, each of our axes is."""


_PX4 = re.compile(r"_(vehicle_(attitude|imu|angular_velocity|acceleration)|sensor_\w+)(_\d+)?$")
"""How ulog2csv names the files of the topics that have axes."""
_CORE_MOTION = re.compile(r"^accelerometerAcceleration[XYZ]\(G\)$")
"""How SensorLog for iOS names what Apple's Core Motion gives."""


def known_frame(proposal: Proposal) -> None:
    """Turn a stream whose program has axes of its own, and say so."""
    table = proposal.table
    path = table.file.path
    autopilot = "north, east, down and forward, right, down"
    of_px4 = path.suffix.lower() == ".ulg" or table.type.startswith("px4_msgs/")
    if of_px4 or _PX4.search(path.stem):
        _turn(proposal, "down", f"PX4 has {autopilot}")
    elif table.type == "DataFlash":
        _turn(proposal, "down", f"ArduPilot has {autopilot}")
    elif proposal.stream == "accelerometer" and _CORE_MOTION.search(proposal.columns[0]):
        proposal.columns = tuple(f"-{name}" for name in proposal.columns)
        proposal.reasons.append("Core Motion shows -1 g along an axis that points up")
    elif any("MIP Monitor" in line for line in table.preamble):
        _turn(proposal, "down", f"MicroStrain has {autopilot}")
    elif any(line.startswith("Format Version") for line in table.preamble):
        _turn(proposal, "y up", "Motive has y up, unless it was told otherwise")
        proposal.unsure.append("whether Motive exported with y up")


def _turn(proposal: Proposal, frame: str, reason: str) -> None:
    columns, order = proposal.columns, _TURNED[frame]
    if proposal.stream == "attitude" and len(columns) == 4:
        turned = (columns[0], *(sign + columns[1 + place] for sign, place in order))
    elif proposal.keys.get("format") == '"euler_zyx"' and frame == "down":
        turned = tuple(sign + column for sign, column in zip(("-", "-", ""), columns, strict=True))
    elif proposal.stream in ("gyro", "accelerometer", "magnetometer", "position", "velocity"):
        turned = tuple(sign + columns[place] for sign, place in order)
    else:
        return
    proposal.columns = turned
    proposal.reasons.append(reason)
