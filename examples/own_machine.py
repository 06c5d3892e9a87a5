"""Begin a machine of your own, put a number of yours into it, and fly it."""

import shutil
from pathlib import Path

import twin

folder = Path("runs/examples/my_table")
shutil.rmtree(folder, ignore_errors=True)
twin.new(folder, "table")
print(sorted(path.name for path in folder.iterdir()))

# platform.toml holds the numbers, platform.xml (MJCF) the bodies; docs/platforms.md has every key
stated = folder / "platform.toml"
text = stated.read_text()
stated.write_text(text.replace('title = "', 'title = "My first table: ', 1))

machine = twin.load(folder)
print(f"{machine.title}: {machine.mass:g} kg, wheels {[wheel.name for wheel in machine.wheels]}")

run = twin.fly(machine, "quaternion_pd", duration=20.0)
print(run)

# what a lab measures may be hidden in the simulation, one effect or several at a time
rubbing = twin.fly(machine, "quaternion_pd", duration=20.0, effects="bearing_viscous_friction=0.05")
print(rubbing)
