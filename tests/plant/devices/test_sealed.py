"""Lines over UDP with a key: what is taken is what the other end sent, once and in its order."""

import os
import secrets
import socket
import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from twin.emulate.emulated import NETWORK_FAULTS, Fault
from twin.emulate.packets import SealedEnd, free_port
from twin.errors import DeviceError
from twin.plant.devices.device import Counters
from twin.plant.devices.port import Port
from twin.plant.devices.sealed import FAR_END, HOST, LONGEST, Seal

KEY = bytes(range(32))


def ends(key: bytes = KEY) -> tuple[Seal, Seal]:
    return Seal(KEY, HOST, Counters()), Seal(key, FAR_END, Counters())


def exchange(one: Seal, other: Seal, packet: bytes, now: float) -> bytes:
    """Give a packet, and each reply to whom it is for, until nobody replies."""
    data, here, there = one.opened(packet, now), one, other
    for _ in range(5):
        reply = here.reply()
        if not reply:
            return data
        here, there = there, here
        here.opened(reply, now)
    raise AssertionError("they go on replying")


def greeted(now: float = 0.0) -> tuple[Seal, Seal]:
    host, far = ends()
    for packet in host.packets(b"lost, for nobody is known yet"):
        assert exchange(far, host, packet, now) == b""
    for packet in host.packets(b"first"):
        assert exchange(far, host, packet, now) == b"first"
    for packet in far.packets(b"answer"):
        assert exchange(host, far, packet, now) == b"answer"
    return host, far


def test_bytes_of_any_length_go_both_ways_after_one_greeting():
    host, far = greeted()
    data = secrets.token_bytes(3 * LONGEST + 7)
    assert b"".join(far.opened(packet, 1.0) for packet in host.packets(data)) == data
    assert b"".join(host.opened(packet, 1.0) for packet in far.packets(data)) == data


MOVES = ["dropped", "same", "again", "flipped", "cut", "mixed", "old"]


@given(st.lists(st.tuples(st.sampled_from(MOVES), st.integers(0, 2**31)), max_size=60))
@settings(max_examples=200, deadline=None)
def test_whatever_a_network_does_only_what_was_sent_is_taken_once_and_in_order(moves):
    """Numbered pieces over a network that drops, repeats, damages and reorders."""
    yesterday_host, yesterday_far = greeted()
    old = [*yesterday_host.packets(b"old"), *yesterday_far.packets(b"old")]
    host, far = greeted()
    taken: list[int] = []
    waiting: list[bytes] = []
    now = 0.0
    for number, (move, draw) in enumerate(moves):
        now += 0.3
        (packet,) = host.packets(number.to_bytes(4, "big"))
        if move == "flipped":
            place = draw % len(packet)
            packet = packet[:place] + bytes([packet[place] ^ (1 << draw % 8)]) + packet[place + 1 :]
        elif move == "cut":
            packet = packet[: draw % len(packet)]
        waiting += {"dropped": [], "again": [packet] * 3, "old": [*old, packet]}.get(move, [packet])
        if move == "mixed":
            waiting.reverse()
        for each in [waiting.pop() for _ in range(min(len(waiting), draw % 3))]:
            # nothing but this packet: no reply helps it
            data = far.opened(each, now)
            taken += [int.from_bytes(data, "big")] if data else []
    assert taken == sorted(set(taken))
    assert all(number < len(moves) for number in taken), "of another day"


@given(st.binary(max_size=300))
@settings(max_examples=300, deadline=None)
def test_garbage_is_a_strangers_and_gets_no_answer(packet):
    host, far = greeted()
    assert far.opened(packet, 9.0) == host.opened(packet, 9.0) == b""
    assert far.reply() == host.reply() == b""
    assert far._counters.strangers == 1


def test_another_key_is_neither_heard_nor_answered():
    host, far = ends(bytes(32))
    for packet in host.packets(b"hello"):
        assert far.opened(packet, 0.0) == far.reply() == b""
    assert far._counters.strangers == 1


def test_a_packet_that_is_sent_back_to_its_sender_is_not_taken():
    host, far = greeted()
    for end in (host, far):
        (packet,) = end.packets(b"mine")
        assert end.opened(packet, 5.0) == end.reply() == b""


def test_packets_of_another_day_neither_act_nor_disturb_a_live_session():
    host, far = greeted()
    recorded = [*host.packets(b"slew"), *host.packets(b"slew again")]
    host, far = greeted()
    for packet in recorded:
        assert far.opened(packet, 0.5) == far.reply() == b""
    assert far._counters.repeats == 2
    (packet,) = host.packets(b"hold")
    assert far.opened(packet, 0.6) == b"hold"
    # when nobody was heard for long an offer is made, which the recorder cannot accept
    for packet in recorded:
        assert far.opened(packet, 9.0) == b""
        assert far.reply()
    (packet,) = host.packets(b"hold on")
    assert far.opened(packet, 9.1) == b"hold on"


@pytest.mark.parametrize("which", ["host", "far end"])
def test_an_end_that_starts_anew_is_taken_up_again_once_the_old_session_is_silent(which):
    host, far = greeted()
    host, far = (ends()[0], far) if which == "host" else (host, ends()[1])
    heard, now = b"", 0.0
    for _ in range(40):
        now += 0.1
        for packet in host.packets(b"ping"):
            heard += exchange(far, host, packet, now)
        for packet in far.packets(b"pong") if far.greeted else []:
            exchange(host, far, packet, now)
    assert b"ping" in heard


@pytest.fixture
def key(tmp_path):
    file = tmp_path / "board.key"
    file.touch(0o600)
    file.write_text(KEY.hex() + "\n")
    return file


@pytest.mark.parametrize("kind", sorted(NETWORK_FAULTS))
def test_a_port_over_udp_is_a_line_under_every_fault_of_a_network(key, kind):
    url = f"udp://127.0.0.1:{free_port()}?key={key}"
    counters = Counters()
    faults = [Fault(kind, 0.0, 30.0, share=0.3)] if kind != "power_cycle" else []
    clock = iter(0.001 * k for k in range(100_000))
    far = SealedEnd(url, faults, 2, lambda: next(clock))
    near = Port("board", url, baud=9600, counters=counters)
    try:
        sent = [b"%04d" % number for number in range(120)]
        there, here = b"", b""
        for piece in sent:
            near.write(piece)
            time.sleep(2e-4)
            there += far.read()
            far.write(piece)
            here += near.waiting()
        pieces = {there[k : k + 4] for k in range(0, len(there), 4)}
        assert pieces <= set(sent)
        for heard in (there, here):
            order = [heard[k : k + 4] for k in range(0, len(heard), 4)]
            assert order == sorted(set(order)), "twice, or out of order"
        assert kind in ("silence", "unplug") or len(here) > 80
    finally:
        near.close()
        far.close()


def test_a_stranger_with_the_boards_port_is_counted(key):
    url = f"udp://127.0.0.1:{free_port()}?key={key}"
    counters = Counters()
    far, near = SealedEnd(url, [], 0, lambda: 0.0), Port("b", url, baud=9600, counters=counters)
    try:
        near.write(b"hello")
        here = near._serial._port.here
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.sendto(b"\x00" * 60, ("127.0.0.1", here))
            time.sleep(0.02)
            assert near.waiting() == b""
            assert counters.strangers == 1
    finally:
        near.close()
        far.close()


def test_a_key_is_asked_for_and_never_shown(tmp_path, key, monkeypatch):
    short = tmp_path / "short.key"
    short.touch(0o600)
    short.write_text("abcd")
    words = tmp_path / "words.key"
    words.touch(0o600)
    words.write_text("correct horse battery staple")
    monkeypatch.setenv("TWIN_KEY", KEY.hex())
    monkeypatch.delenv("TWIN_NO_KEY", raising=False)
    for options, why in {
        "": "has a key",
        f"key={key}&key_env=TWIN_KEY": "one of them",
        "key=missing.key": "No such file",
        "key_env=TWIN_NO_KEY": "not set",
        f"key={short}": "2 bytes",
        f"key={words}": "no hexadecimal number",
    }.items():
        with pytest.raises(DeviceError, match=why) as problem:
            Port("board", f"udp://127.0.0.1:5005?{options}", baud=9600)
        assert "horse" not in str(problem.value)
        assert KEY.hex() not in str(problem.value)
    with pytest.raises(DeviceError, match="another computer"):
        Port("board", f"udp://192.168.1.2:5005?key={key}", baud=9600)
    Port("board", "udp://127.0.0.1:5005?key_env=TWIN_KEY", baud=9600).close()
    if os.name == "posix":
        key.chmod(0o644)
        with pytest.raises(DeviceError, match="others can read"):
            Port("board", f"udp://127.0.0.1:5005?key={key}", baud=9600)
