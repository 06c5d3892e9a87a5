"""A schema as the C header that a far end's firmware is compiled with."""

from twin.plant.devices.link.schema import Schema

_SAFE = {"": "LINK_MEASURED", "zero": "LINK_ZERO", "hold": "LINK_HOLD"}


def c_header(schema: Schema, name: str, longest_valid_ms: int) -> str:
    """`schema.h`: the channels' table, their numbers, and the hash for the greeting.

    Args:
        schema: What the far end carries.
        name: How it greets, ASCII.
        longest_valid_ms: The longest time for which it takes a set-point [ms].
    """
    numbers = [
        f"#define CHANNEL_{channel.stream.upper()} {number} /* {channel.columns} columns"
        f" [{channel.unit}], "
        + (f"{channel.scale!r} a count */" if channel.number == "int32" else "float32 */")
        for number, channel in enumerate(schema.channels)
    ]
    rows = [
        f"    {{{channel.columns}, {int(channel.number == 'int32')}, {_SAFE[channel.safe]}}},"
        for channel in schema.channels
    ]
    return "\n".join(
        (
            "/* The channels of a far end, made by a program: do not edit. */",
            "#ifndef SCHEMA_H",
            "#define SCHEMA_H",
            "",
            '#include "link.h"',
            "",
            *numbers,
            "",
            "static const struct link_channel schema_channels[] = {",
            *rows,
            "};",
            "",
            "static const struct link_schema schema = {",
            f"    0x{schema.hash:08X}u, {longest_valid_ms}, {len(schema.channels)}, "
            f'schema_channels, "{name}",',
            "};",
            "",
            "#endif",
            "",
        )
    )
