"""The campaigns that are shipped can be flown."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from twin.campaigns.draw import draw
from twin.campaigns.flight import flown
from twin.campaigns.merit import METRICS
from twin.campaigns.read import KEYS, read_spec

DOCS = Path(__file__).parents[2] / "docs"
SHIPPED = sorted((DOCS / "campaigns").glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_a_shipped_campaign_flies_its_first_seconds_to_the_same_bits_in_any_company(path):
    spec = replace(read_spec(path), duration=2.0, steady=1.0)
    several = flown(spec, draw(spec, range(4)))
    for run in (0, 3):
        # repr, for a run that is not balanced yet has metrics that are NaN
        assert repr(flown(spec, draw(spec, [run]))[run]) == repr(several[run])
    assert {one.ended for one in several.values()} <= {"done", "stopped"}


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_each_pair_of_a_comparison_starts_on_one_machine(path):
    spec = read_spec(path)
    drawn = draw(spec, range(8))
    for value in drawn.values.values():
        assert np.array_equal(value[::2], value[1::2])
    assert drawn.arms.tolist() == [0, 1] * 4


def test_the_page_tells_every_key():
    told = (DOCS / "campaigns.md").read_text(encoding="utf-8")
    for key in KEYS:
        assert f"`{key}`" in told or f"`[{key}]`" in told or f"`[[{key}]]`" in told, key


def test_the_page_tells_every_metric():
    told = (DOCS / "campaigns.md").read_text(encoding="utf-8")
    for name, metric in METRICS.items():
        assert f"| `{name}` | {metric.unit} | " in told, name


def test_the_file_on_the_page_can_be_flown_as_it_stands(tmp_path):
    told = (DOCS / "campaigns.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```toml\n(.*?)```", told, re.DOTALL)
    path = tmp_path / "spec.toml"
    path.write_text(text, encoding="utf-8")
    spec = read_spec(path)
    assert (spec.samples, spec.points) == (256, 2), "256 machines with each of two gains"
