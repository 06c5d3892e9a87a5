"""Paper 004: what is computed for its tables and figures, as far as it is quick."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from twin.reproduce.inertia import is_rigid_body, tensor
from twin.reproduce.paper_004 import table1_wheels, table2_unphysical
from twin.reproduce.paper_004.manoeuvre import hanging, machine
from twin.reproduce.paper_004.parts import PARTS
from twin.rotation import rotate

ROWS = Path(__file__).parents[2] / "docs" / "reproduction.toml"


def test_no_row_is_computed_twice_nor_one_that_was_not_fixed_before():
    rows = tomllib.loads(ROWS.read_text(encoding="utf-8"))["row"]
    wanted = [row["id"] for row in rows if row["id"].startswith("004.")]
    found = [name for part in PARTS for name in part.ids]
    assert len(set(found)) == len(found)
    assert set(found) <= set(wanted)


def test_held_level_the_offset_of_table_1_fills_a_wheel():
    (ours,) = table1_wheels.compute(print).rows.values()
    # 95 kg, 0.1 mm: 0.093 N m about each horizontal axis, for 300 s, in units of 5 N m s
    assert ours.value == pytest.approx(0.0931950 * 300.0 / 5.0, rel=1e-3)


def test_four_of_the_five_recursive_inertias_are_no_bodies():
    (ours,) = table2_unphysical.compute(print).rows.values()
    assert ours.value == 1.0


def test_a_plate_is_the_limit_of_what_a_body_can_be():
    assert is_rigid_body(tensor(np.array([1.0, 2.0, 2.999, 0.0, 0.0, 0.0])))
    assert not is_rigid_body(tensor(np.array([1.0, 2.0, 3.001, 0.0, 0.0, 0.0])))
    assert not is_rigid_body(tensor(np.array([1.0, 1.0, 1.0, 1.1, 0.0, 0.0])))


def test_hanging_means_that_the_offset_points_down():
    platform = machine("sads:table1")
    down = rotate(hanging(platform), platform.center_of_mass_offset)
    np.testing.assert_allclose(down / np.linalg.norm(down), [0.0, 0.0, -1.0], atol=1e-12)
