"""Frames that a program is known to write in, turned into ours: z up, x forward."""

from twin.intake.streams import Proposal

_TURNED = {
    "down": (("", 0), ("-", 1), ("-", 2)),
    "y up": (("", 0), ("-", 2), ("", 1)),
}
"""Which column, and with which sign, each of our axes is."""


def known_frame(proposal: Proposal) -> None:
    """Turn a stream whose program has axes of its own, and say so."""
    table = proposal.table
    path = table.file.path
    if path.suffix.lower() == ".ulg" or table.type.startswith("px4_msgs/"):
        _turn(proposal, "down", "PX4 has north, east, down and forward, right, down")
    elif any(line.startswith("Format Version") for line in table.preamble):
        _turn(proposal, "y up", "Motive has y up, unless it was told otherwise")
        proposal.unsure.append("whether Motive exported with y up")


def _turn(proposal: Proposal, frame: str, reason: str) -> None:
    columns, order = proposal.columns, _TURNED[frame]
    if proposal.stream == "attitude" and len(columns) == 4:
        turned = (columns[0], *(sign + columns[1 + place] for sign, place in order))
    elif proposal.stream in ("gyro", "accelerometer", "magnetometer", "position", "velocity"):
        turned = tuple(sign + columns[place] for sign, place in order)
    else:
        return
    proposal.columns = turned
    proposal.reasons.append(reason)
