"""The balance of angular momentum as equations that are linear in J and m r: the papers' methods.

Each takes the gyro as it was read. What noise is in the columns biases the answer, and intervals
that come from the scatter of what is left do not know of it.
"""
