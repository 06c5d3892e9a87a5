"""Whatever bytes come, the link's parser raises nothing, keeps little, and hears what is good."""

from hypothesis import given, settings
from hypothesis import strategies as st

from twin.plant.devices.link import (
    LONGEST_PAYLOAD,
    Channel,
    Frame,
    MessageType,
    Parser,
    SampleRows,
    Schema,
    packed,
)
from twin.plant.devices.link.frame import stuff, unstuff
from twin.plant.devices.link.near_end import NearEnd

SCHEMA = Schema((Channel("gyro", "rad/s", 3), Channel("command_dipole", "A m^2", 3, safe="zero")))
FRAMES = st.builds(
    Frame,
    st.integers(0, 255),
    st.binary(max_size=LONGEST_PAYLOAD),
    st.integers(0, 0xFFFF),
    st.integers(0, 2**32 - 1),
    st.integers(0, 0xFFFF),
    st.integers(0, 255),
    st.integers(0, 255),
)
"""Every check passes; what they say may be nonsense."""
LINES = st.lists(st.one_of(st.binary(max_size=300), FRAMES.map(packed)), max_size=12)


@given(st.binary(min_size=1, max_size=254))
def test_what_is_stuffed_comes_back_without_a_zero_in_between(data: bytes):
    assert unstuff(stuff(data)) == data
    assert 0 not in stuff(data)


@given(LINES, st.integers(1, 97), st.sampled_from(["host", "far end"]))
@settings(max_examples=300, deadline=None)
def test_frames_are_the_same_however_the_line_is_cut_and_memory_is_bounded(
    pieces: list[bytes], cut: int, sender: str
):
    line = b"".join(pieces)
    whole, parts = Parser(SCHEMA, sender), Parser(SCHEMA, sender)
    frames: list[Frame] = []
    for start in range(0, len(line), cut):
        frames += parts.feed(line[start : start + cut])
        assert len(parts._rest) <= 255
    assert frames == whole.feed(line)
    assert vars(parts.counters) == vars(whole.counters)
    samples = SampleRows(0, (), SCHEMA.channels[0].unpacked(bytes(12))[:0].reshape(0, 3))
    last = (parts.last_sequence or 0) + 1 & 0xFFFF
    kind, payload = (
        (MessageType.samples, samples.packed(SCHEMA))
        if sender == "far end"
        else (MessageType.disarm, b"")
    )
    good = Frame(kind, payload, last)
    assert parts.feed(b"\0" + packed(good)) == [good]


@given(LINES)
@settings(max_examples=300, deadline=None)
def test_our_end_makes_something_of_any_bytes_without_raising(pieces: list[bytes]):
    near = NearEnd(SCHEMA, "fuzzed")
    near.greet(0.0)
    for number, piece in enumerate(pieces):
        for sample in near.hear(piece, 0.01 * number):
            assert len(sample.value) == 3
            assert sample.valid == all(abs(x) < float("inf") for x in sample.value)
    near.event_sentences()
