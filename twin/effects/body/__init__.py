"""Effects on the machine itself: torques from outside, and parts that move inside."""
