"""Find out what a model lacks, extend it by that, and measure the gain on another log."""

import shutil
from pathlib import Path

import twin

# two logs of a table whose bearing rubs and whose wheels' speeds come late; the model knows neither
hidden = "bearing_viscous_friction=0.02,clock_lag:wheel_speed=0.1"
first, second = (
    twin.fly("sads", "quaternion_pd", duration=60.0, effects=hidden, seed=seed).recording
    for seed in (1, 2)
)

# a lab's log has no true states, and the diagnosis does not look at those of a simulation
found = twin.diagnose(first, "sads", say=print)
print(found)
for cause in found.causes:
    print(cause.effect.words(), f"evidence {cause.evidence:.0f}")

print(twin.validate(found, second))

folder = Path("runs/examples/sads_as_it_is")
shutil.rmtree(folder, ignore_errors=True)
extended = twin.extend(found, folder)
print("and the extended model is", twin.diagnose(second, extended).verdict)

found.save("runs/examples/why.html")
