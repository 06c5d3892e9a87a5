"""Cameras in a network against their emulations on ports of this computer."""

import socket
import struct
import sys
import time
from contextlib import closing

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.plant.devices.swing import PERIOD, Swing, attitude_at, place_at, served
from twin.emulate.cameras import EmulatedNatNet, EmulatedVicon
from twin.emulate.emulated import NETWORK_FAULTS, Fault
from twin.emulate.packets import free_port
from twin.errors import DeviceError, UsageError
from twin.plant.devices.cameras import NatNetSettings, ViconSettings, decode_vicon
from twin.plant.devices.natnet import decode_frame, decode_models, decode_server, opened

SEEN = ("attitude", "position")
ROOM = {"origin": (0.5, -0.25, 1.0), "turn": (0.5, 0.5, 0.5, 0.5)}
"""Cameras whose axes and origin are not the room's."""


def port() -> str:
    return f"udp://127.0.0.1:{free_port()}"


def natnet(version=(4, 1), **changed):
    made = NatNetSettings(name="cameras", port=port(), body="table", **{**ROOM, **changed})
    return made, EmulatedNatNet(made, Swing(), SEEN, version)


def vicon(**changed):
    made = ViconSettings(name="cameras", port=port(), body="table", **{**ROOM, **changed})
    return made, EmulatedVicon(made, Swing(), SEEN)


SYSTEMS = {
    "NatNet 3.0": lambda: natnet((3, 0)),
    "NatNet 4.1": natnet,
    "NatNet 4.2": lambda: natnet((4, 2)),
    "Vicon": vicon,
    "Vicon, zyx": lambda: vicon(order="zyx"),
}


def true(samples):
    """How many valid samples there are, each where the body was at some frame; else it fails."""
    times = PERIOD * np.arange(3000)
    known = {
        "attitude": np.array([attitude_at(at) for at in times]),
        "position": np.array([place_at(at) for at in times]),
    }
    count = 0
    for sample in samples:
        if sample.valid:
            misses = np.abs(known[sample.stream] - sample.value).max(axis=1)
            if sample.stream == "attitude":
                other = np.abs(known[sample.stream] + sample.value).max(axis=1)
                misses = np.minimum(misses, other)
            assert misses.min() < 2e-6, f"never so: {sample}"
            count += 1
    return count


@pytest.mark.wall_clock
@pytest.mark.parametrize("system", SYSTEMS)
def test_a_body_is_where_and_as_the_cameras_see_it(system, wait_for):
    made, device = SYSTEMS[system]()
    with served(device, made.port), closing(made.session()) as session:
        session.configure()
        samples = wait_for(session, lambda seen: len(seen) >= 60)
    assert true(samples) == len(samples)
    assert {sample.stream for sample in samples} == {"attitude", "position"}
    assert session.counters.frames >= 30
    assert session.counters.strangers == 0
    stamps = [sample.device_time for sample in samples if sample.stream == "attitude"]
    np.testing.assert_allclose(np.diff(stamps), PERIOD, atol=1e-6)
    assert all(sample.latency >= 0.0 for sample in samples)


@pytest.mark.wall_clock
@pytest.mark.parametrize("system", ["NatNet 4.1", "Vicon"])
def test_under_each_fault_of_a_network_nothing_wrong_is_believed(system, wait_for):
    made, device = SYSTEMS[system]()
    # a bit that flips is found by UDP's own checksum, which this computer's own network leaves out
    kinds = [kind for kind in NETWORK_FAULTS if kind != "garble"]
    faults = [Fault(kind, 0.2 + 0.2 * k, 0.15, share=0.4) for k, kind in enumerate(kinds)]
    with served(device, made.port, *faults, seed=3), closing(made.session()) as session:
        session.configure()
        started, end = time.monotonic(), 0.2 * len(kinds) + 0.4
        samples = wait_for(session, lambda seen: bool(seen) and seen[-1].host_time > started + end)
    assert true(samples) >= 100
    attitudes = [sample for sample in samples if sample.valid and sample.stream == "attitude"]
    assert len({sample.value for sample in attitudes}) == len(attitudes), "a frame counts twice"
    assert session.counters.repeats > 0
    assert session.counters.gaps > 0
    assert session.counters.strangers > 0 or sys.platform != "linux"


@pytest.mark.wall_clock
@pytest.mark.parametrize("system", ["NatNet 4.1", "Vicon"])
def test_a_body_that_the_cameras_lose_is_no_sample_and_says_so(system, wait_for, reasons):
    made, device = SYSTEMS[system]()
    lost = Fault("lost", 0.2, value=0.2)
    with served(device, made.port, lost), closing(made.session()) as session:
        session.configure()
        samples = wait_for(
            session, lambda seen: [s.valid for s in seen[-40:]] == [True] * 40 and len(seen) > 90
        )
    assert "the cameras do not see table" in reasons(samples)
    true(samples)


@pytest.mark.wall_clock
def test_a_body_whose_number_changes_is_followed_by_its_name(wait_for):
    made, device = natnet()
    with served(device, made.port, Fault("renamed", 0.3)), closing(made.session()) as session:
        session.configure()
        wait_for(session, lambda _: any("number 13" in note for note in session.notes))
        samples = wait_for(session, lambda seen: sum(s.valid for s in seen) >= 20)
    true(samples)


@pytest.mark.wall_clock
def test_frames_that_begin_anew_are_taken_and_noted(wait_for):
    made, device = vicon()
    device._frame = 100_000
    with served(device, made.port, Fault("restart", 0.3)), closing(made.session()) as session:
        session.configure()
        samples = wait_for(session, lambda seen: any("anew" in n for n in session.notes))
    assert true(samples)


@pytest.mark.wall_clock
@pytest.mark.parametrize("system", ["NatNet 4.1", "Vicon"])
def test_a_body_that_is_not_streamed_is_refused_with_those_that_are(system, monkeypatch):
    monkeypatch.setattr("twin.plant.devices.cameras._TRIES", 4)
    made, device = SYSTEMS[system]()
    device._settings = made
    asked = type(made)(name="cameras", port=made.port, body="chair")
    with served(device, made.port), pytest.raises(DeviceError, match="'chair'.*table"):
        asked.session().connect()


def test_nothing_is_heard_of_other_computers_unless_it_is_asked_for():
    for url, why in {
        "udp://192.168.3.4:1510": "another computer.*remote",
        "udp://0.0.0.0:1510": "no computer",
        "udp://motive:1510": "four numbers",
        "udp://127.0.0.1": "four numbers",
        "udp://127.0.0.1:1510?far": "option 'far'",
    }.items():
        made = NatNetSettings(name="cameras", port=url, body="table")
        with pytest.raises(DeviceError, match=why):
            made.session().connect()
    with pytest.raises(UsageError, match="no port of cameras"):
        NatNetSettings(name="cameras", port="/dev/ttyUSB0", body="table")


def test_a_port_that_is_taken_says_so():
    made, _ = vicon()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", int(made.port.rpartition(":")[2])))
        with pytest.raises(DeviceError, match="cannot listen"):
            made.session().connect()


def test_a_server_of_an_unknown_version_is_refused():
    made, device = natnet((5, 0))
    with served(device, made.port), pytest.raises(DeviceError, match=r"5\.0.*4\.2 are read"):
        made.session().connect()


GOOD = {
    "frame": (decode_frame, (3, 0)),
    "newer frame": (decode_frame, (4, 1)),
    "models": (decode_models, (3, 0)),
    "newer models": (decode_models, (4, 2)),
}


def good_packet(kind: str) -> bytes:
    decode, version = GOOD[kind]
    _, device = natnet(version)
    device.receive(struct.pack("<HH", 10, 0), 0.0)
    packet = (
        device.advance(0.0)[0]
        if decode is decode_frame
        else device.receive(struct.pack("<HH", 4, 0), 0.0)[0]
    )
    whole = opened(packet)
    assert whole is not None
    assert decode(whole[1], version)
    return whole[1]


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_whatever_packet_comes_the_parsers_raise_nothing(data):
    kind = data.draw(st.sampled_from(sorted(GOOD)))
    decode, version = GOOD[kind]
    packet = bytearray(good_packet(kind))
    for place, byte in data.draw(
        st.lists(st.tuples(st.integers(0, len(packet) - 1), st.integers(0, 255)), max_size=8)
    ):
        packet[place] = byte
    cut = bytes(packet[: data.draw(st.integers(0, len(packet)))])
    for tried in (cut, bytes(packet), data.draw(st.binary(max_size=600))):
        result = decode(tried, version)
        # a body takes 38 bytes, so no packet makes more of them than it has room for
        assert result is None or len(getattr(result, "bodies", result)) <= len(tried) // 4
        decode_server(tried)
        decode_vicon(tried)
        opened(tried)


def test_a_frame_is_read_byte_by_byte_as_its_layout_says():
    payload = struct.pack("<iiii", 77, 0, 0, 1)
    payload += struct.pack("<i3f4ffh", 12, 1, 2, 3, 0.0, 0.0, 0.6, 0.8, 1e-4, 1)
    payload += struct.pack("<iiii", 0, 0, 0, 0)
    payload += struct.pack("<IIdQQQHi", 0, 0, 1.5, 100, 150, 200, 2, 0)
    frame = decode_frame(payload, (3, 0))
    assert frame is not None
    assert (frame.number, frame.exposure, frame.sent, frame.models_changed) == (77, 100, 200, True)
    assert frame.bodies[12].place == (1.0, 2.0, 3.0)
    np.testing.assert_allclose(frame.bodies[12].attitude, (0.8, 0.0, 0.0, 0.6), atol=1e-7)
    assert decode_frame(payload[:-20], (3, 0)) is None
