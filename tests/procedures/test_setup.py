"""What cannot work is refused before it starts, with the number."""

from dataclasses import replace

import numpy as np
import pytest

from twin.errors import ControllerError, UnknownName, UsageError
from twin.platform import load_platform
from twin.procedures import Refused, balancing, random_offsets, refuse, usual_target
from twin.procedures.fits import filter_moment, fit_moment
from twin.procedures.means import Reach, damper

BALANCED = ("cubesat", "tas2", "astros", "sads", "whorl2")


def test_offset_beyond_the_masses_reach_is_refused_with_the_millimetres():
    astros = load_platform("astros")
    with pytest.raises(Refused, match=r"s3 would have to stand at 38\.\d+ mm.*-25 to 25 mm"):
        refuse(astros, "direct", 0.001, astros.center_of_mass_offset)


def test_same_offset_found_with_the_mass_at_its_lower_end_is_not_refused():
    astros = load_platform("astros")
    low = Reach.of(astros).moment(np.array([[0.0, 0.0, -0.025]]))[0]
    refuse(astros, "direct", 0.001, astros.center_of_mass_offset - low)


def test_wheels_that_would_saturate_while_tracking_are_named_with_the_second():
    sads, hung = load_platform("sads"), np.array([0.0, 0.0, -0.02])
    refuse(sads, "adaptive", 0.01, hung)
    weak = replace(sads, wheels=tuple(replace(w, momentum_limit=0.2) for w in sads.wheels))
    with pytest.raises(Refused, match=r"w\d will saturate.* 0\.2 N m s at \d+ s"):
        refuse(weak, "adaptive", 0.01, hung)
    refuse(weak, "direct", 0.01, hung)


@pytest.mark.parametrize("name", BALANCED)
def test_random_offsets_are_within_reach_and_do_not_depend_on_how_many_are_drawn(name):
    platform = load_platform(name)
    offsets = random_offsets(platform, 3, 20)
    for offset in offsets:
        refuse(platform, "direct", usual_target(platform), offset)
    np.testing.assert_array_equal(offsets[:5], random_offsets(platform, 3, 5))


@pytest.mark.parametrize("name", BALANCED)
def test_every_machine_with_three_stages_has_a_procedure_and_something_that_damps(name):
    platform = load_platform(name)
    damper(platform, 0.1)
    procedure = balancing(platform, 2, way="direct", target=usual_target(platform), workers=0)
    assert not procedure.finished(procedure.init(platform, 2)).any()


def test_machine_without_stages_is_refused():
    with pytest.raises(ControllerError, match="the 0 stages of"):
        Reach.of(load_platform("dfki_pendulum"))


@pytest.mark.parametrize("way", ["direct", "masses", "masses-and-filter", "adaptive"])
def test_machine_on_which_nothing_shows_the_vertical_is_refused_before_it_moves(way):
    astros = load_platform("astros")
    blind = {"attitude", "inclinometer", "accelerometer"}
    sensors = {name: sensor for name, sensor in astros.sensors.items() if name not in blind}
    with pytest.raises(UsageError, match="none of it shows how the body leans: carry an incl"):
        balancing(replace(astros, sensors=sensors), 1, way=way, target=1e-3, workers=0)


def test_machine_without_a_gyro_is_refused_before_it_moves():
    astros = load_platform("astros")
    sensors = {"inclinometer": astros.sensors["inclinometer"]}
    with pytest.raises(UsageError, match=r"without a gyro .* \[sensors.gyro\], or level it by"):
        balancing(replace(astros, sensors=sensors), 1, way="direct", target=1e-3, workers=0)


@pytest.mark.parametrize("shows", ["inclinometer", "accelerometer", "attitude"])
def test_machine_that_shows_the_vertical_somehow_is_balanced(shows):
    astros = load_platform("astros")
    others = {"attitude", "inclinometer", "accelerometer"} - {shows}
    sensors = {name: sensor for name, sensor in astros.sensors.items() if name not in others}
    machine = replace(astros, sensors=sensors)
    procedure = balancing(machine, 1, way="direct", target=1e-3, workers=0)
    assert procedure.lab.fits.by is (fit_moment if shows == "attitude" else filter_moment)


def test_unknown_procedure_is_named_with_the_known():
    with pytest.raises(UnknownName, match="adaptive"):
        balancing(load_platform("cubesat"), 1, way="adaptiv", target=1e-4, workers=0)
