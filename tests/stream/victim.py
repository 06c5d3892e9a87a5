"""A process that records in real time until it is killed, and says how far it has got."""

import sys
import time

import numpy as np

from twin.platform import load_platform
from twin.signals import Estimate, Reading, Samples, Target, Tick
from twin.stream.provenance import provenance
from twin.stream.recorder import FileRecorder


def main(path: str) -> None:
    platform = load_platform("sads")
    recorder = FileRecorder(path)
    recorder.start(platform, provenance(platform, seed=0))
    level, still = np.array([[1.0, 0.0, 0.0, 0.0]]), np.zeros((1, 3))
    started = time.monotonic()
    tick = 0
    while True:
        now = tick * platform.tick
        times = now - 0.01 * np.arange(5.0)[None, ::-1]
        gyro = Samples(np.full((1, 5, 3), now), times, np.ones((1, 5), dtype=np.bool_))
        estimate = Estimate(
            now, level, still, still, still, still[:, :0], still[:, :0], still, np.array([True])
        )
        torque = {"command_wheel_torque": np.full((1, 3), now)}
        reading = Reading(now, {"gyro": gyro})
        recorder.collect(Tick(reading, estimate, Target(level[0]), torque, torque, {}))
        print(repr(now), flush=True)
        tick += 1
        time.sleep(max(0.0, started + tick * platform.tick - time.monotonic()))


if __name__ == "__main__":
    main(sys.argv[1])
