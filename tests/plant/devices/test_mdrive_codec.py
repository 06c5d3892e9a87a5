"""The MCode codec: the manual's checksum, replies of every echo mode, any bytes taken."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.plant.devices.mdrive_line import (
    ERRORS,
    Acknowledgement,
    Answer,
    ErrorEffect,
    ExchangeState,
    checksum,
    error_named,
    frame,
    question,
)

VALUE = b"1a-20157_1_0_31002"
CHECKED = VALUE + bytes([checksum(VALUE)])
VALUES = (-20157, 1, 0, 31002)
QUESTION = b'1PR "1a"P,"_"MV,"_"EF,"_"R1'


@pytest.mark.parametrize(("text", "known"), [(b"MR 1", 0x90), (b"1MR 1", 0xDF)])
def test_checksums_are_those_of_the_manual(text, known):
    assert checksum(text) == known
    assert (sum(text) + known) & 0x7F == 0, "what a receiver tests"


def test_a_command_is_name_text_checksum_and_line_feed():
    assert frame("1", "MA 20000", checked=False) == b"1MA 20000\n"
    assert frame("1", "MR 1", checked=True) == b"1MR 1\xdf\n"
    assert frame("a", "PR P", checked=False) == b"aPR P\n"


def test_a_question_prints_its_tag_before_the_values():
    assert frame("1", question("1a", ["P", "MV", "EF", "R1"]), checked=False) == QUESTION + b"\n"


def test_a_command_longer_than_a_drives_buffer_is_refused():
    with pytest.raises(ValueError, match="has more than 64 characters"):
        frame("1", "PR " + "P," * 31, checked=False)


ECHO = QUESTION
REPLIES = {
    "no echo": VALUE + b"\r\n",
    "extra line first": b"\r\n" + VALUE + b"\r\n",
    "two extra lines": b"\r\n\r\n" + VALUE + b"\r\n",
    "full echo": ECHO + b"\r\n" + VALUE + b"\r\n>",
    "full echo, joined": ECHO + VALUE + b"\r\n>",
    "full echo, error pending": b"?" + ECHO + b"\r\n" + VALUE + b"\r\n?",
    "echo at the end": ECHO + b"\r\n" + VALUE + b"\r\n",
    "prompt before": b">" + VALUE + b"\r\n",
    "no line feed": VALUE + b"\r",
    "another answer before": b"2z5_0_0_1\r\n" + VALUE + b"\r\n",
    "a name of its own accord": b"1" + VALUE + b"\r\n",
    "twice": VALUE + b"\r\n" + VALUE + b"\r\n",
}


@pytest.mark.parametrize("reply", REPLIES.values(), ids=REPLIES)
def test_the_answer_is_found_in_every_echo_mode_byte_by_byte(reply):
    answer = Answer("1a", checked=False)
    for byte in reply:
        answer.feed(bytes([byte]))
    assert answer.state is ExchangeState.done
    assert answer.values == VALUES


@pytest.mark.parametrize(
    "reply",
    [
        CHECKED + b"\r\n\x06",
        b"\x06" + CHECKED + b"\r\n",
        ECHO + bytes([checksum(ECHO)]) + b"\r\n" + CHECKED + b"\r\n\x06>",
        VALUE + b"\r\n" + CHECKED[-1:],
    ],
)
def test_a_checksum_is_found_wherever_it_stands(reply):
    answer = Answer("1a", checked=True)
    assert answer.feed(reply) is ExchangeState.done
    assert answer.values == VALUES


def test_a_list_of_values_may_be_separated_as_the_drive_prints_it():
    answer = Answer("1a", checked=False)
    answer.feed(b"1a7, 0\r\n")
    assert answer.values == (7, 0)
    known = Answer("x", checked=False)  # the reply that a program in use shows, behind a tag
    known.feed(b"x0_0_0_0\r\n")
    assert known.values == (0, 0, 0, 0)


@pytest.mark.parametrize("where", range(len(CHECKED)))
@pytest.mark.parametrize("bit", range(8))
def test_no_single_wrong_bit_of_a_checked_answer_gives_a_wrong_value(where, bit):
    broken = bytearray(CHECKED)
    broken[where] ^= 1 << bit
    answer = Answer("1a", checked=True)
    answer.feed(bytes(broken) + b"\r\n")
    assert answer.state is not ExchangeState.done or answer.values == VALUES


def test_an_answer_without_its_checksum_is_not_one():
    answer = Answer("1a", checked=True)
    assert answer.feed(VALUE + b"\r\n\r\n") is ExchangeState.waiting
    assert Answer("1a", checked=True).feed(b"\x15") is ExchangeState.refused
    wrong = VALUE + bytes([checksum(VALUE) ^ 1]) + b"\r\n"
    assert Answer("1a", checked=True).feed(wrong) is ExchangeState.corrupt


@pytest.mark.parametrize("tag", ["1b", "2a"])
def test_a_late_answer_or_another_drives_is_not_taken(tag):
    assert Answer(tag, checked=False).feed(VALUE + b"\r\n") is ExchangeState.waiting


@pytest.mark.parametrize(
    ("echo_mode", "checked", "reply", "state"),
    [
        (0, False, b"1VM=5\r\n>", ExchangeState.done),
        (0, False, b"1VM=5\r\n?", ExchangeState.done),
        (1, False, b"\r\n", ExchangeState.done),
        (2, False, b"", ExchangeState.done),
        (3, False, b"1VM=5\r\n", ExchangeState.done),
        (0, True, b"1VM=5\x06>", ExchangeState.done),
        (1, True, b"\x06", ExchangeState.done),
        (1, True, b"\r\n\x15", ExchangeState.refused),
        (3, True, b"1VM=5\x06", ExchangeState.done),
        (1, True, b"\r\n", ExchangeState.waiting),
    ],
)
def test_an_acknowledgement_is_known_in_every_mode(echo_mode, checked, reply, state):
    heard = Acknowledgement(b"1VM=5\n", echo_mode=echo_mode, checked=checked)
    assert heard.feed(reply) is state


@given(st.lists(st.binary(max_size=300), max_size=10), st.booleans())
@settings(max_examples=300, deadline=None)
def test_any_bytes_are_taken_and_the_answer_behind_them_is_found(chunks, checked):
    answer = Answer("1a", checked=checked)
    heard = Acknowledgement(b"1VM=5\n", echo_mode=1, checked=checked)
    for chunk in chunks:
        answer.feed(chunk)
        heard.feed(chunk)
        assert len(answer._buffer) <= 512
        assert len(heard._buffer) <= 512
    if answer.state is ExchangeState.waiting:
        answer.feed(b"\r\n" + (CHECKED if checked else VALUE) + b"\r\n")
        assert answer.state in (ExchangeState.done, ExchangeState.corrupt)


def test_every_error_code_says_what_follows():
    assert {83, 84} == {code for code, e in ERRORS.items() if e.effect is ErrorEffect.limit}
    assert {72, 86, 92} == {code for code, e in ERRORS.items() if e.effect is ErrorEffect.lost}
    assert error_named(99).effect is ErrorEffect.stopped
