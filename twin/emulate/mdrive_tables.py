"""Variables, error codes and control bytes of the MCode manual, as the emulated drive uses them."""

from collections.abc import Mapping

FAULTS: Mapping[str, str] = {
    "lost_reply": "the next replies are not sent (value: how many)",
    "double_reply": "the next replies come twice (value: how many)",
    "garbled_reply": "the next replies have one wrong bit (value: how many)",
    "late_reply": "the next reply comes late (value: seconds)",
    "extra_newline": "every reply begins with a CR LF from now on",
    "wrong_address": "it answers to another name too (value: its code)",
    "error": "an error is pending (value: its code)",
    "reboot": "it starts anew of itself, without a word",
    "stuck_moving": "it says for ever that it moves",
    "stall": "the motor stands, and the drive knows",
    "newline_only": "the next replies are empty lines (value: how many)",
    "completion": "it sends its name of itself",
    "not_acknowledged": "the next commands are refused with NAK (value: how many)",
    "baud": "it talks at another rate (value: baud)",
}
"""What can go wrong inside it -> what then happens."""

ACK, NAK, ESC, BREAK = 0x06, 0x15, 0x1B, 0x03
BUFFER = 64
UNKNOWN, BAD_VALUE, READ_ONLY, NO_LABEL, NOT_PRINTABLE = 20, 21, 25, 30, 35
SPEEDS_CROSS, SAVE_MOVING, LOAD_MOVING, BUSY_HOMING = (22, 23), 73, 74, 85
BAUDS = {"48": 4800, "96": 9600, "19": 19200, "38": 38400, "11": 115200}
MICROSTEPS = (1, 2, 4, 5, 8, 10, 16, 25, 32, 50, 64, 100, 108, 125, 127, 128, 180, 200, 250, 256)

# name: (factory value, lowest, highest)
WRITABLE: Mapping[str, tuple[int, int, int]] = {
    "P": (0, -(2**31), 2**31 - 1),
    "VI": (1000, 1, 5_000_000),
    "VM": (768_000, 1, 5_000_000),
    "A": (1_000_000, 91, 1_525_878_997),
    "D": (1_000_000, 91, 1_525_878_997),
    "MS": (256, 1, 256),
    "RC": (25, 1, 100),
    "HC": (5, 0, 100),
    "HT": (500, 0, 65535),
    "MT": (0, 0, 65535),
    "DE": (1, 0, 1),
    "LM": (1, 1, 6),
    "EM": (0, 0, 3),
    "CK": (0, 0, 2),
    "PY": (0, 0, 1),
    "QD": (0, 0, 1),
    "DG": (1, 0, 1),
    "EE": (0, 0, 1),
    "ES": (1, 0, 3),
    "CE": (1, 0, 2),
    "ER": (0, 0, 99),
    "ST": (0, 0, 1),
    "R1": (0, -(2**31), 2**31 - 1),
    "R2": (0, -(2**31), 2**31 - 1),
    "R3": (0, -(2**31), 2**31 - 1),
    "R4": (0, -(2**31), 2**31 - 1),
}
READ_ONLY_NAMES = ("V", "VC", "MV", "MP", "EF", "BY", "VR", "PN", "SN", "C1", "C2")
