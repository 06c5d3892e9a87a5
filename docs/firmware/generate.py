"""Write schema.h and vectors.txt, the two files that both ends of our link share.

    python docs/firmware/generate.py

A laboratory edits SCHEMA to the channels that its board carries, here and in its platform.toml,
and compiles link.c with the schema.h that comes out. vectors.txt is a conversation with that far
end, a line for each time something comes: its clock [us], what the host sends, what it answers.
check_vectors.c lets the C code have the same conversation.
"""

from pathlib import Path

import numpy as np

from twin.plant.devices.link import (
    ArmRequest,
    Channel,
    Frame,
    Hello,
    MessageType,
    Schema,
    SetPoint,
    TimeSync,
    packed,
)
from twin.plant.devices.link.far_end import FarEnd
from twin.plant.devices.link.schema import c_header

SCHEMA = Schema(
    (
        Channel("gyro", "rad/s", 3),
        Channel("accelerometer", "m/s^2", 3),
        Channel("magnetometer", "T", 3),
        Channel("stage_position", "m", 3, "int32", 2e-6),
        Channel("command_stage_position", "m", 3, "int32", 2e-6, "hold"),
        Channel("command_dipole", "A m^2", 3, safe="zero"),
    )
)
"""Three stepper stages of 2 um a step, three magnetorquers and an IMU behind a Feather M0."""

NAME = "feather"
LONGEST_VALID_MS = 500

Step = tuple[int, bytes, str]
"""Far end's clock [us], what the host sends, what it is about."""

_FULL_CIRCLE = 2**32


def conversation() -> list[Step]:
    """What the host says, and when; the far end starts at the first step."""
    said: list[Step] = []
    number = 0

    def say(now: int, kind: int, payload: bytes, about: str) -> None:
        nonlocal number
        said.append((now, packed(Frame(kind, payload, number, 3 * now)), about))
        number += 1

    def dipole(value: float, valid_for: int) -> bytes:
        return SetPoint(5, valid_for, np.array([value, 0.0, -1.0])).packed(SCHEMA)

    def stages(counts: float, valid_for: int) -> bytes:
        return SetPoint(4, valid_for, 2e-6 * np.array([counts, -1, 0])).packed(SCHEMA)

    hello = Hello(SCHEMA.hash, 0, "twin").packed()
    arm = ArmRequest(SCHEMA.hash, 200).packed()
    said.append((1000, b"", "it starts, and greets"))
    say(1500, MessageType.arm, arm, "armed before the greeting: refused")
    say(2000, MessageType.hello, Hello(7, 0, "twin").packed(), "another schema: refused")
    say(3000, MessageType.hello, hello, "the greeting")
    say(4000, MessageType.timesync, TimeSync(10**12 + 1).packed(), "clocks")
    say(5000, MessageType.setpoint, dipole(0.5, 100), "a set-point, but it is not armed")
    say(6000, MessageType.arm, ArmRequest(SCHEMA.hash, 501).packed(), "armed for too long: refused")
    say(7000, MessageType.arm, arm, "armed")
    say(8000, MessageType.setpoint, dipole(0.5, 100), "a dipole for 0.1 s")
    say(9000, MessageType.setpoint, dipole(np.nan, 100), "not a number: refused")
    say(9500, MessageType.setpoint, dipole(np.inf, 100), "not finite: refused")
    say(9600, MessageType.setpoint, stages(np.nan, 100), "no count: refused")
    say(9700, MessageType.setpoint, dipole(0.5, 0), "valid for no time: refused")
    say(10_000, MessageType.setpoint, stages(1500, 400), "stages for 0.4 s")
    said.append((107_999, b"", "the dipole is still valid"))
    said.append((108_000, b"", "now it is over: safe"))
    say(109_000, MessageType.setpoint, dipole(0.5, 100), "refused, it is not armed any more")
    say(110_000, MessageType.arm, arm, "armed again")
    said.append((310_000, b"", "no set-point came: safe"))
    say(320_000, MessageType.arm, arm, "armed")
    say(321_000, MessageType.safe_stop, b"", "safe, at once")
    say(330_000, MessageType.arm, arm, "armed")
    say(331_000, MessageType.setpoint, stages(-2e9, 500), "far, but it fits into 32 bits")
    say(332_000, MessageType.hello, hello, "another host greets: safe")
    say(333_000, MessageType.arm, arm, "armed")
    say(334_000, MessageType.disarm, b"", "no longer")
    say(340_000, 99, b"what?", "a type that it does not know: counted, no answer")
    say(341_000, MessageType.disarm, b"!", "a payload that does not fit: counted, no answer")
    good = packed(Frame(MessageType.safe_stop, b"", number))
    said.append((342_000, good[:6] + bytes((good[6] ^ 4,)) + good[7:], "a flipped bit: no answer"))
    said.append((343_000, good[:9], "the first half of a frame"))
    said.append((344_000, good[9:], "and the second"))
    said.append((345_000, good, "the same once more: dropped"))
    said.append((346_000, b"\x09" * 400 + b"\0\0\0" + b"\x05\x01\0", "noise"))
    number += 4
    say(347_000, MessageType.safe_stop, b"", "three frames were lost before this one")
    say(_FULL_CIRCLE - 50_000, MessageType.arm, arm, "the clock is about to wrap")
    say(_FULL_CIRCLE - 40_000, MessageType.setpoint, dipole(0.25, 100), "a dipole for 0.1 s")
    said.append((59_999, b"", "the clock has wrapped, the dipole is still valid"))
    said.append((60_000, b"", "now it is over"))
    return said


def vectors() -> str:
    """The text of vectors.txt."""
    steps = conversation()
    far_end = FarEnd(SCHEMA, NAME, LONGEST_VALID_MS, steps[0][0])
    lines = ["# clock [us], bytes of the host, bytes of the far end; made by generate.py"]
    for now, said, about in steps:
        far_end.receive(said, now)
        lines += [f"# {about}", f"{now} {said.hex() or '-'} {far_end.take().hex() or '-'}"]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write both files beside this one."""
    here = Path(__file__).parent
    (here / "schema.h").write_text(c_header(SCHEMA, NAME, LONGEST_VALID_MS), encoding="utf-8")
    (here / "vectors.txt").write_text(vectors(), encoding="utf-8")


if __name__ == "__main__":
    main()
