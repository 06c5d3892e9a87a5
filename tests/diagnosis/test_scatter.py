"""What only makes a sensor scatter is as sure as its rivals let it be."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from twin.diagnosis import cause as scatter
from twin.diagnosis.cause import Cause
from twin.effects import Effect
from twin.platform import load_platform


@pytest.fixture
def explanation() -> Any:
    """Of a machine with stages, as far as the choice among causes looks at it."""
    platform = replace(load_platform("cubesat"), effects=())
    return SimpleNamespace(
        follows=True, bodies=[SimpleNamespace(machine=SimpleNamespace(platform=platform))]
    )


def gains(monkeypatch: pytest.MonkeyPatch, sizes: dict[str, float]) -> None:
    def cause(_: object, effect: Effect, taken: object) -> Cause | None:
        size = sizes.get(effect.target)
        one = np.ones(1)
        return None if size is None else Cause(effect, one > 0.0, one, one, size, size, 1.0, ())

    monkeypatch.setattr(scatter, "_cause", cause)


def test_stages_that_would_shake_a_gyro_alike_are_a_tie(explanation, monkeypatch):
    gains(monkeypatch, {"s1": 80.0, "s2": 79.9, "s3": 20.0})
    (named,) = scatter.scatter_causes(explanation)
    assert named.effect.label == "stage_vibration:s1"
    assert [tie.label for tie in named.ties] == ["stage_vibration:s2"]
    assert 0.4 < named.confidence < 0.55


def test_beside_something_without_a_name_none_is_sure(explanation, monkeypatch):
    gains(monkeypatch, {"s1": 80.0})
    (sure, *_), (unsure, *_) = (
        scatter.scatter_causes(explanation, unexplained=nameless) for nameless in (False, True)
    )
    assert sure.confidence > 0.99
    assert unsure.confidence < 0.3
