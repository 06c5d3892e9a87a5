"""What the two shipped machines that have a rate alone say of themselves."""

import numpy as np

from twin.identification import identify
from twin.library import library
from twin.platform import load_platform
from twin.recording.log import open_log
from twin.report import identified


def test_the_two_steps_of_the_cubesat_agree_on_its_body_and_motor():
    logs = library("models") / "vnucec_cubesat" / "logs"
    platform = load_platform("vnucec_cubesat")
    one, other = (identify([open_log(logs / n)], platform) for n in ("first_step", "second_step"))
    for name in ("J", "damping of wheel"):
        place = one.base.names.index(name)
        apart = abs(one.theta[place] - other.theta[place])
        assert apart < np.hypot(one.half_widths[place], other.half_widths[place]), name
    assert not one.misfit[0].is_noise, "the line does what a spring and a damper do not"


def test_the_fork_is_identified_from_its_volts():
    log = open_log(library("models") / "bicycle_fork" / "logs" / "first_swing")
    said = identified(identify([log.between(0.0, 8.0)], load_platform("bicycle_fork")))
    text = "\n".join(said)
    assert "J     0.96" in text
    assert "rad/s per V" in text
    assert "it is that of the stated m r" in text
