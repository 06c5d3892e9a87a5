"""Fly a machine over its serial lines: here against their emulation, so no machine moves.

On the bench the plant is `serial`, with the ports of the platform's [hardware] (docs/hardware.md).
"""

import twin

# nothing leaves unless it is armed: sensors are read and the law is computed, and that is all
dry = twin.fly("cubesat", "mass_pid", plant="pty", lockstep=True, duration=2.0)
print(dry)

# the operator has looked, and says that the table floats
flown = twin.fly(
    "cubesat", "mass_pid", plant="pty", lockstep=True, arm="floating", duration=10.0, say=print
)
print(flown)
moves = flown.recording["command_stage_position"]
print(f"{len(moves)} set-points of {', '.join(moves.columns)}")
flown.save("runs/examples/bench.rrd")
