"""Bring the centre of mass of a table into its centre of rotation, to a stated torque."""

import twin

done = twin.balance("cubesat", offset=(2e-5, -1e-5, -8e-5), seed=3, say=print)
print(done)

(statement,) = done.statements
left = statement.residual_torque
print(f"left: {left.value * 1e6:.1f} uN m ({left.low * 1e6:.1f} to {left.high * 1e6:.1f})")
done.save("runs/examples/balanced.json")
done.save("runs/examples/balanced.png")
