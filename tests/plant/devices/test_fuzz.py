"""Random and mutated bytes into each parser; `python -m benchmarks fuzz` feeds ten million."""

import pytest

from benchmarks.fuzz import (
    BLOCK,
    PIECE,
    MDriveReplies,
    OurLink,
    Rvc,
    Solar2Text,
    VectorNav,
    Xbus,
    fuzz,
)

KEPT = {
    OurLink: 255,
    Xbus: 2048 + PIECE,
    MDriveReplies: 512,
    Solar2Text: 64,
    Rvc: 18,
    VectorNav: 53,
}
"""Bytes that each may keep."""


@pytest.mark.parametrize("kind", KEPT, ids=lambda kind: kind.__name__)
def test_a_parser_survives_any_bytes_and_hears_the_next_good_message(kind):
    subject = kind()
    _, deaf = fuzz(subject, 4 * BLOCK, seed=2)
    assert deaf == 0
    assert subject.most <= KEPT[kind]
