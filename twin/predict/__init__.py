"""Prediction of logs: a log, a platform and parameters give whitened innovations and their columns.

`logs` reads the motion, `inputs` and `profiles` what drives it, `response` cuts it into segments,
`rollouts` and `swing` carry them, `sensors` predicts readings, `kalman` whitens them, and
`innovations` or `independent_segments` pose the fit. `base`, `columns`, `forces` and `added` are
its parameters.
"""
