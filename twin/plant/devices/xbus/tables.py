"""What the Xbus protocol of Xsens (Movella) motion trackers is made of, as data.

From the vendor's public sources (message, data and baud-rate identifiers of its `xspublic` library)
and from Python drivers in use for the error codes.
"""

from dataclasses import dataclass
from enum import IntEnum


class MessageId(IntEnum):
    """Messages that a driver sends or hears; an acknowledgement is the request's plus one."""

    REQUEST_DEVICE_ID = 0x00
    GO_TO_MEASUREMENT = 0x10
    REQUEST_FIRMWARE_REVISION = 0x12
    SET_BAUD_RATE = 0x18
    GO_TO_CONFIG = 0x30
    DATA = 0x36
    WAKE_UP = 0x3E
    WAKE_UP_ACKNOWLEDGE = 0x3F
    RESET = 0x40
    ERROR = 0x42
    WARNING = 0x43
    SET_OUTPUT_CONFIGURATION = 0xC0


ERRORS = {
    0x03: "a period that it does not know",
    0x04: "a message that it does not know, or not in this state",
    0x1E: "its timer ran over",
    0x20: "a baud rate that it does not know",
    0x21: "a parameter out of range",
    0x23: "its transmit buffer is full",
    0x24: "its transmit buffer is full",
    0x28: "an error inside the device",
    0x29: "more data than the line can carry",
    0x2D: "its supply dipped",
    0x2F: "it is too hot",
}
"""Code of an error message -> what the device complains about."""

BAUD_CODES = {
    9600: 0x09,
    19200: 0x07,
    38400: 0x05,
    115200: 0x02,
    230400: 0x01,
    460800: 0x00,
    921600: 0x80,
    2000000: 0x0C,
    3500000: 0x0E,
    4000000: 0x0D,
}
"""Baud -> code in SetBaudRate."""

PRECISIONS = {"float32": 0, "fp12.20": 1, "fp16.32": 2, "float64": 3}
"""Number format -> bits 0 and 1 of a data identifier."""

NUMBER_BYTES = (4, 4, 6, 8)
"""Size of one number, by those bits."""


@dataclass(frozen=True)
class DataItem:
    """One kind of data in an MTData2 message."""

    name: str
    width: int
    """Numbers in it."""
    integer: str = ""
    """Code of `struct` for integers; empty: real numbers in the format of the identifier."""


DATA_ITEMS = {
    0x1020: DataItem("packet_counter", 1, "H"),
    0x1060: DataItem("sample_time_fine", 1, "I"),
    0x1070: DataItem("sample_time_coarse", 1, "I"),
    0x10A0: DataItem("sample_time", 1, "Q"),
    0x10B0: DataItem("packet_counter_long", 1, "I"),
    0x0810: DataItem("temperature", 1),
    0x2010: DataItem("quaternion", 4),
    0x2020: DataItem("rotation_matrix", 9),
    0x2030: DataItem("euler_angles", 3),
    0x3010: DataItem("pressure", 1, "I"),
    0x4010: DataItem("velocity_increment", 3),
    0x4020: DataItem("acceleration", 3),
    0x4030: DataItem("free_acceleration", 3),
    0x4040: DataItem("acceleration_high_rate", 3),
    0x8020: DataItem("rate_of_turn", 3),
    0x8030: DataItem("orientation_increment", 4),
    0x8040: DataItem("rate_of_turn_high_rate", 3),
    0xC020: DataItem("magnetic_field", 3),
    0xE010: DataItem("status_byte", 1, "B"),
    0xE020: DataItem("status_word", 1, "I"),
}
"""Data identifier, its low four bits (number format, frame) cleared -> what it carries."""

PACKET_COUNTER = 0x1020
SAMPLE_TIME_FINE = 0x1060
TICKS = 10_000
"""Of SampleTimeFine a second."""
MAXIMUM_RATE = 0xFFFF
"""Asks for an item with every packet."""


@dataclass(frozen=True)
class Channel:
    """A canonical stream that the device can give."""

    kind: int
    """Data identifier."""
    width: int


CHANNELS = {
    "gyro": Channel(0x8020, 3),
    "accelerometer": Channel(0x4020, 3),
    "magnetometer": Channel(0xC020, 3),
    "attitude": Channel(0x2010, 4),
    "temperature": Channel(0x0810, 1),
}
"""Stream -> where it is from. An MTi-1 has no attitude; from an MTi-2 or -3 on there is one."""
