"""Fly many runs that differ, and see what the result depends on."""

import shutil
from pathlib import Path

import numpy as np

import twin

folder = Path("runs/examples/campaign")
shutil.rmtree(folder, ignore_errors=True)
spec = Path("runs/examples/campaign.toml")
spec.parent.mkdir(parents=True, exist_ok=True)
spec.write_text("""
platform = "sads"
controller = "quaternion_pd"
runs = 64
duration = 20.0
seed = 1
sampling = "sobol"

[effects.bearing_viscous_friction]
damping = { uniform = [0.0, 0.1] }

[effects.gyro_bias]

[[arms]]
name = "as shipped"

[[arms]]
name = "stiffer"
[arms.gains]
proportional = 20.0
derivative = 16.0
""")

if __name__ == "__main__":  # each worker is a process that imports this file
    found = twin.campaign(spec, folder, workers=2)
    print(found)
    error = np.degrees(found.results.metrics["tracking_error_rms"])
    for arm in ("as shipped", "stiffer"):
        print(f"{arm}: median {np.median(error[found.results.of(arm)]):.2f} deg rms")
    print(twin.replay(folder, 5))
    found.save("runs/examples/campaign.html")
