"""The first hour: an own machine, law and log; diagnosed, extended, balanced, flown at random."""

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import twin
from twin.controller.exchange import fixed_axes
from twin.controller.pointing import pointing_error

here = Path("runs/examples/first_hour")
shutil.rmtree(here, ignore_errors=True)

# 1. A machine: a folder to begin with, and a fourth wheel, in platform.toml and in the MJCF.
table = here / "table"
twin.new(table)
stated, drawn = table / "platform.toml", table / "platform.xml"
wheel = 'name = "w4"\ninertia = 0.005\nmomentum_limit = 2.0\ntorque_limit = 0.1\n'
stated.write_text(stated.read_text().replace("[[stages]]", f"[[wheels]]\n{wheel}\n[[stages]]", 1))
body = """<body name="w4" pos="0.15 0.15 0.12" childclass="wheel">
        <joint name="w4" axis="0.57735 0.57735 0.57735"/>
        <inertial pos="0 0 0" mass="2" diaginertia="0.005 0.005 0.005"/>
        <geom/>
      </body>
      <body name="s1" """
motor = '<motor name="w4" joint="w4" class="wheel"/>\n    <position name="s1"'
mjcf = drawn.read_text().replace('<body name="s1" ', body, 1)
drawn.write_text(mjcf.replace('<position name="s1"', motor, 1))
machine = twin.load(table)
print(f"{machine.title}, {machine.mass:g} kg, wheels {[w.name for w in machine.wheels]}")


# 2. A law: arrays have the runs first, so that one law flies one run or a thousand.
@dataclass(frozen=True)
class Feedback(twin.Controller[np.ndarray]):
    """Attitude feedback, shared among the wheels by the pseudoinverse of their axes."""

    proportional: float = 4.0
    derivative: float = 6.0

    def init(self, platform, n):
        return -np.linalg.pinv(fixed_axes(platform, "feedback").T)

    def update(self, state, estimate, target, time):
        error, rate_error = pointing_error(estimate, target)
        torque = -self.proportional * error[:, 1:] - self.derivative * rate_error
        return {"command_wheel_torque": torque @ state.T * estimate.valid[:, None]}, state


# 3. A log of two minutes, here of the same table with a bearing that rubs: nobody told the model.
rubbing = "bearing_viscous_friction=0.05"
path = {"reference": "multisine:8@0.05", "duration": 60.0}
measured, second = (twin.fly(table, Feedback(), effects=rubbing, seed=s, **path) for s in (1, 2))
measured.save(here / "measured")  # tables and a log.toml, as `twin import` makes of any program's
log = twin.read(here / "measured")
print(twin.show(log))

# 4. What the model lacks, how sure that is, the model with it, and its gain on another log.
found = twin.diagnose(log, table)
print(found)
print(twin.validate(found, second.recording))
better = twin.extend(found, here / "better")
found.save(here / "why.html")

# 5. The masses moved until gravity's torque is small, and a campaign over what differs.
print(twin.balance(better, offset=(2e-5, -1e-5, -8e-5), seed=3))
spec = here / "campaign.toml"
spec.write_text(f"""platform = "{table}"
controller = "quaternion_pd"
runs = 16
seed = 1
duration = 20.0
[effects.bearing_viscous_friction]
damping = {{ uniform = [0.0, 0.1] }}
""")
print(twin.campaign(spec, here / "campaign", workers=2))
