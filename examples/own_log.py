"""Bring a log that another program wrote: a table of a pendulum's angle, in degrees."""

import shutil
from pathlib import Path

import numpy as np

import twin

folder = Path("runs/examples/my_log")
shutil.rmtree(folder, ignore_errors=True)
folder.mkdir(parents=True)

rng = np.random.default_rng(1)
time = np.arange(0.0, 20.0, 0.01)
angle = 20.0 * np.exp(-0.02 * time) * np.cos(4.43 * time) + 0.05 * rng.standard_normal(len(time))
rate = np.gradient(angle, time)
table = "\n".join(f"{t:.3f},{a:.4f},{r:.4f}" for t, a, r in zip(time, angle, rate, strict=True))
measured = folder / "swing.csv"
measured.write_text(f"time [s],angle [deg],rate [deg/s]\n{table}\n")

# with the machine that it is of, an angle is known to be that of its hinge
log = twin.import_log(measured, folder, platform="dfki_pendulum")
print((folder / "log.toml").read_text())  # what it was taken for, and why; correct it there
print(twin.show(log))

for name, series in log.items():
    print(name, series.value.shape, series.unit, f"{series.rate:.0f} Hz")
