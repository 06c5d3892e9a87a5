"""What is named beside a cause is what its logs cannot tell from it."""

import numpy as np
import pytest

from twin.diagnosis.cause import ties_of
from twin.diagnosis.screen import LinearScreen, Search, Trace

SIZE = 8.0
"""Standard deviations that the cause is worth."""


def ties(apart: float, behind: float) -> tuple[str, ...]:
    """Of a cause in a log whose noise left a rival so much behind, of which without noise it would
    be `apart`."""
    sine = np.sqrt(apart) / SIZE
    cosine = np.sqrt(1.0 - sine**2)
    cause, rival = np.array([1.0, 0.0, 0.0]), np.array([cosine, sine, 0.0])
    pushed = (np.sqrt(SIZE**2 - behind) - SIZE * cosine) / sine
    shown = np.array([SIZE, pushed, 0.0])
    traces = [Trace(name, np.array([-np.inf]), np.array([np.inf])) for name in ("cause", "rival")]
    base = np.array([[0.0], [0.0], [1.0]])
    screen = LinearScreen(-shown, base, 3.0 * np.column_stack([cause, rival]), traces)
    search = Search(screen, range(2))
    ties = ties_of(search, search.instead((0,), 0), search.apart((0,), 0))
    return tuple(tie.label for tie in ties)


@pytest.mark.parametrize("behind", [0.5, 3.0, 5.5])
def test_what_the_log_could_not_tell_from_it_is_a_tie(behind):
    assert ties(apart=5.0, behind=behind) == ("rival",)


@pytest.mark.parametrize("behind", [3.0, 5.5])
def test_what_it_could_is_none_where_it_fell_behind(behind):
    assert ties(apart=12.0, behind=behind) == ()


def test_what_came_out_even_is_a_tie_whatever_the_log_could_tell():
    assert ties(apart=12.0, behind=1.0) == ("rival",)


def test_what_is_far_behind_is_none():
    assert ties(apart=5.0, behind=6.5) == ()
