"""Which files a simulation of a machine reads, of all that lie in its folder."""

from pathlib import Path, PureWindowsPath
from xml.etree import ElementTree

from twin.platform.parts import Platform


def files_of(platform: Platform) -> dict[str, Path]:
    """platform.toml, the MJCF and the files that this names, by their way from the folder.

    Whatever else lies there (notes, pictures, logs, campaigns) has no say in what is flown. A file
    counts as named if an attribute of the MJCF, or of one that it includes, ends in its name:
    where MuJoCo looks for it depends on directories that several elements state, and one too many
    does no harm.
    """
    below = [path for path in platform.folder.rglob("*") if path.is_file()]
    found = {platform.folder / "platform.toml", platform.model_path}
    unread = [platform.model_path]
    while unread:
        named = _names_in(unread.pop())
        more = {path for path in below if path.name in named} - found
        found |= more
        unread += more
    return {path.relative_to(platform.folder).as_posix(): path for path in sorted(found)}


def _names_in(path: Path) -> set[str]:
    """Last parts of what the attributes of an MJCF say; none where it is a mesh or a picture."""
    try:
        # `load_platform` has refused document types, in which entities could grow without bound
        elements = list(ElementTree.parse(path).iter())
    except (ElementTree.ParseError, LookupError, ValueError):  # the last two: its encoding
        return set()
    # a Windows path may be written with strokes of either kind
    return {PureWindowsPath(value).name for one in elements for value in one.attrib.values()}
