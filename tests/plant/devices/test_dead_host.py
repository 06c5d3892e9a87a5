"""A host that is killed in the middle of a move: an MDrive, which has no watchdog, rests soon."""

import re
from pathlib import Path

import pytest

from tests.plant.devices.hosts import killed
from tests.plant.devices.stages import BAUD, STEP, drives
from tests.processes import wait_until
from twin.emulate.line import EmulatedLine
from twin.emulate.mdrive import Ramps, move
from twin.plant.devices.mdrive_line import Answer, ExchangeState, frame, question
from twin.plant.devices.port import Port

pytestmark = pytest.mark.wall_clock

HORIZON = 0.25
"""[s]: no move is longer than VM times this."""

HOST = """
import sys
import time
from tests.plant.devices.hosts import killed
from tests.plant.devices.stages import BAUD, go, stage
from twin.plant.devices.mdrive import MDriveSettings

settings = MDriveSettings(name="stages", port=sys.argv[1], baud=BAUD, drives=(stage(),))
session = settings.session()
session.configure()
session.arm()
told = False
while True:
    go(session, 0.02)
    for sample in session.read():
        if not told and sample.valid and sample.value[0] > 0.008:
            told = True
            print("moving", flush=True)
    time.sleep(0.01)
"""


def asked(port: Port, *items: str) -> tuple[int, ...]:
    """What the drive prints to somebody who only asks."""
    for tag in ("1y", "1z") * 10:
        answer = Answer(tag, checked=True)
        port.write(frame("1", question(tag, items), checked=True))
        while data := port.read(0.5):
            if answer.feed(data) is ExchangeState.done:
                return answer.values
    pytest.fail("the drive does not answer")


def test_after_the_death_of_its_host_a_stage_ends_one_short_move_and_rests(tmp_path: Path):
    log = tmp_path / "bytes"
    with EmulatedLine(drives(), tmp_path / "port", log=log) as line:
        killed(HOST, line.link, "moving")
        died = log.read_text()
        port = Port("stages", str(line.link), baud=BAUD)
        wait_until(lambda: asked(port, "MV") == (0,))
        rest, speed, up, down, initial = asked(port, "P", "VM", "A", "D", "VI")
        port.close()
    sent = b"".join(bytes.fromhex(row[1:]) for row in died.splitlines() if row[0] == "<")
    targets = [0, *(int(each) for each in re.findall(rb"1MA (-?\d+)", sent))]
    longest = speed * HORIZON
    assert speed == round(0.025 / STEP)
    ways = [abs(after - before) for before, after in zip(targets, targets[1:], strict=False)]
    assert max(ways) <= longest + 1
    assert len(ways) >= 2, "it went on by short moves"
    assert rest == targets[-1], "the move that was begun is ended, and no other"
    ramps = Ramps(initial=initial, maximum=speed, up=up, down=down)
    takes = move(0.0, longest, ramps, 0.0).end
    assert takes <= HORIZON + speed / down, "at rest 0.25 s and one ramp after the last command"
