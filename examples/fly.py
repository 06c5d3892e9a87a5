"""Fly a shipped machine under a shipped law, look at the run, and save it."""

import numpy as np

import twin

run = twin.fly("sads", "quaternion_pd", reference="slew:0,0,30@1", duration=60.0, seed=1)
print(run)  # as `twin run` prints it

# every stream has its own clock and SI units; a simulation's true states are there, too
wheels = run.recording["wheel_speed"]
print(f"{len(wheels)} rows of {', '.join(wheels.columns)} at {wheels.rate:.0f} Hz")
print("fastest wheel", f"{np.abs(wheels.value).max():.1f} rad/s")
print("tracking error", f"{np.degrees(run.metrics['tracking_error_rms_rad']):.2f} deg rms")

run.save("runs/examples/slew.rrd")  # for `twin view` and every other verb
run.save("runs/examples/slew.png")  # one panel a stream
