"""Sessions over a line and a board that fail at random: nothing false, nothing left running."""

import numpy as np

from twin.emulate.emulated import Wire, schedule
from twin.emulate.microcontroller import EmulatedMicrocontroller, EmulatedStages
from twin.plant.devices.link import Channel, FarEndState, Schema
from twin.plant.devices.link.near_end import NearEnd

SCHEMA = Schema(
    (
        Channel("gyro", "rad/s", 3),
        Channel("stage_position", "m", 3, "int32", 2e-6),
        Channel("command_stage_position", "m", 3, "int32", 2e-6, "hold"),
        Channel("command_dipole", "A m^2", 3, safe="zero"),
    )
)
STEP = 0.01
SPAN = 6.0
"""Of one session [s]; then the host dies."""

VALID_MS = 200
FAULTS = ("mute", "deaf", "hang", "reset", "gap", "corrupt", "stuck", "stale", "fault", "drift")
LARGEST = {"gap": 50.0, "corrupt": 20.0, "drift": 1e-3, "fault": 3.0}
"""Of a fault's value; of the others it is a time, up to 0.8 s."""


def shown(step: int) -> np.ndarray:
    """What the gyro shows in a step: three numbers that only belong to it."""
    return np.float32([0.001 * step, 1.0 + 0.001 * step, -0.001 * step]).astype(float)


def test_no_session_believes_what_is_false_or_leaves_an_actuator_on():
    reasons = set[str]()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        kinds = ("drop", "duplicate", "garble", "silence")
        wire = Wire(
            list(schedule(seed, kinds, span=SPAN, mean_gap=1.0, duration=0.3, share=0.01)),
            seed,
        )
        own = [(rng.uniform(0.0, SPAN), rng.choice(FAULTS)) for _ in range(4)]
        board = EmulatedMicrocontroller(
            SCHEMA,
            {"gyro": 50.0, "stage_position": 20.0},
            stages=EmulatedStages(3, speed=0.02, acceleration=0.1),
            clock_us=int(rng.integers(0, 2**32)),
            drift=float(rng.uniform(-1e-4, 1e-4)),
        )
        near = NearEnd(SCHEMA, "board")
        true = {tuple(shown(step)) for step in range(round(SPAN / STEP) + 1)}
        for step in range(round(SPAN / STEP)):
            now = (step + 1) * STEP
            board.shown["gyro"] = shown(step)
            for start, kind in own:
                if now - STEP <= start < now:
                    board.inject(kind, LARGEST.get(kind, 0.8) * rng.random())
            line = b""
            if near.restarted:
                near = NearEnd(SCHEMA, "board")
                reasons.add("restarted")
            if step % 5 == 0:
                if near.greeting is None:
                    line += near.greet(now)
                elif near.state is FarEndState.fault:
                    line += near.disarm(now)
                elif near.state is FarEndState.safe:
                    line += near.arm(500, now)
                else:
                    wish = {
                        "command_dipole": rng.normal(size=3),
                        "command_stage_position": rng.uniform(-0.01, 0.01, 3),
                    }
                    line += near.setpoints(wish, VALID_MS, now)
                line += near.ask_time(now)
            said = board.receive(wire.carry(line, now, matched=True), now)
            for sample in near.hear(wire.carry(said, now, matched=True), now):
                if sample.stream == "gyro":
                    assert sample.value in true, (seed, now, "a false value passed all checks")
            reasons |= {
                sentence.split(": ", 1)[1].split(" (")[0] for sentence in near.event_sentences()
            }
        # the host is dead; a main loop that hangs does so for 0.8 s at most
        dead = round((0.8 + VALID_MS * 1e-3 + 0.5) / STEP)
        for step in range(dead):
            board.advance(SPAN + step * STEP)
        assert board.far_end.state is not FarEndState.armed, seed
        np.testing.assert_array_equal(board.dipole, 0.0)
        held = board.stages.position.copy() if board.stages else np.zeros(3)
        board.advance(SPAN + dead * STEP + 2.0)
        assert board.stages is not None
        np.testing.assert_allclose(board.stages.position, held, atol=2e-6)
    assert {"restarted", "it takes set-points", "LIMIT"} <= reasons, "the campaign hit too little"
