"""Whether what wanders is no more than what any room and any attitude filter have."""

from dataclasses import replace

from twin.diagnose.line import Line
from twin.predict.whitening.noise_model import GaussMarkov

ARM = 2e-7
"""Of a torque that is in any room, as the weight of the machine that acts so far off [m]."""
SHARE = 0.5
"""Of what a model without causes lacks, that causes must carry for the rest to be a wander."""


def is_usual(line: Line) -> bool:
    """Whether torques that wander are as small as in any room, or far less than what is explained.

    What has no name looks like a wander too: it is what is left of it that tells.
    """
    now = line.now
    if not now.noise.pushes:
        return True
    platform = now.bodies[0].machine.platform
    if now.noise.torque.rms < ARM * platform.mass * platform.gravity:
        return True
    without = now.beside(replace(now.noise, torque=GaussMarkov()))
    wander = without.marginal - now.marginal
    causes = line.search.evidence(now.own)
    return causes > SHARE * (causes + max(wander, 0.0))
