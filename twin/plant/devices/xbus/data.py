"""What an MTData2 message carries, and what SetOutputConfiguration asks for. Bytes and values."""

import struct
from collections.abc import Iterable
from dataclasses import dataclass

from twin.plant.devices.xbus.tables import DATA_ITEMS, NUMBER_BYTES, DataItem

_FORMAT, _FRAME = 0x3, 0xC
_REALS = {
    (width, code): struct.Struct(form)
    for width in {item.width for item in DATA_ITEMS.values()}
    for code, form in enumerate((f">{width}f", f">{width}i", ">" + width * "Ih", f">{width}d"))
}
_INTEGERS = {
    item.integer: struct.Struct(">" + item.integer) for item in DATA_ITEMS.values() if item.integer
}
_MOST_OUTPUTS = 32


@dataclass(frozen=True, slots=True)
class Item:
    """One item of a message."""

    kind: int
    """Its data identifier with the number format and the frame cleared."""
    values: tuple[float, ...]
    """As sent: rad/s, m/s^2, deg, degC; counters are whole numbers."""


@dataclass(frozen=True, slots=True)
class Output:
    """One line of an output configuration."""

    identifier: int
    rate: int
    """[Hz]; 0xFFFF (or 0) with every packet."""


def decode_data(data: bytes) -> list[Item] | None:
    """Items in the order sent, without those unknown; None: lengths that contradict the data."""
    items: list[Item] = []
    position, end = 0, len(data)
    while position < end:
        if position + 3 > end:
            return None
        identifier, size = data[position] << 8 | data[position + 1], data[position + 2]
        position += 3
        if position + size > end:
            return None
        kind = identifier & ~(_FORMAT | _FRAME)
        known = DATA_ITEMS.get(kind)
        if known is not None:
            values = _numbers(known, identifier & _FORMAT, data, position, size)
            if values is None:
                return None
            items.append(Item(kind, values))
        position += size
    return items


def _numbers(
    item: DataItem, code: int, data: bytes, start: int, size: int
) -> tuple[float, ...] | None:
    layout = _INTEGERS[item.integer] if item.integer else _REALS[item.width, code]
    if layout.size != size:
        return None
    raw = layout.unpack_from(data, start)
    if item.integer or code in (0, 3):
        return raw
    if code == 1:
        return tuple(number / 2.0**20 for number in raw)
    # fp16.32: the fraction comes first, then the signed whole part
    return tuple(whole + part / 2.0**32 for part, whole in zip(raw[::2], raw[1::2], strict=True))


def packet_bytes(outputs: Iterable[Output]) -> int:
    """Bytes on the line of a message with all these items."""
    size = 0
    for output in outputs:
        item = DATA_ITEMS[output.identifier & ~(_FORMAT | _FRAME)]
        number = (
            struct.calcsize(">" + item.integer)
            if item.integer
            else NUMBER_BYTES[output.identifier & _FORMAT]
        )
        size += 3 + item.width * number
    return size + (5 if size < 255 else 7)


def encode_outputs(outputs: Iterable[Output]) -> bytes:
    """Data of SetOutputConfiguration.

    Raises:
        ValueError: more than 32 items.
    """
    chosen = list(outputs)
    if len(chosen) > _MOST_OUTPUTS:
        raise ValueError(f"{len(chosen)} items: an output configuration holds {_MOST_OUTPUTS}")
    return b"".join(struct.pack(">HH", each.identifier, each.rate) for each in chosen)


def decode_outputs(data: bytes) -> list[Output] | None:
    """The configuration that is in effect, from its acknowledgement; None: not a whole list."""
    if len(data) % 4:
        return None
    return [Output(*pair) for pair in struct.iter_unpack(">HH", data)]
