"""Experiments and routine procedures of a lab: what to fly next, and what to check, calibrate and
tune. In: a platform, or recordings of it. Out: a plan with its forecast, a file, a trend."""
