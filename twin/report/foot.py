"""The foot of a page: when and how it was made, of which logs and which machine."""

import hashlib
import json
import shlex
import sys
from collections.abc import Sequence
from datetime import date
from html import escape
from importlib.metadata import version
from pathlib import Path

from twin.platform import Platform
from twin.recording import Recording
from twin.stream.provenance import hashes_of

LARGEST = 512 * 2**20
"""Bytes of a log up to which it is hashed: a person waits for the page."""
SHOWN = 12
"""Digits of a hash."""


def foot(recordings: Sequence[Recording], platform: Platform | None) -> str:
    """Lines as HTML: version and date, the command, a hash of each log and of the machine's files.

    Args:
        recordings: the logs of the page.
        platform: the machine; None without one.
    """
    lines = [f"airbearing-twin {version('airbearing-twin')}, {date.today().isoformat()}"]
    words = [Path(sys.argv[0]).name, *sys.argv[1:]]
    lines.append("made by: " + shlex.join(words))
    lines += [f"log {_name(log)}: {_hash_of_log(log)}" for log in recordings]
    if platform is not None:
        files = hashes_of(platform.folder)
        text = json.dumps(files, sort_keys=True)
        lines.append(f"platform {platform.name}: sha256 {_sha256(text.encode())[:SHOWN]}")
    return "<footer>" + "".join(f"<p>{escape(line)}</p>" for line in lines) + "</footer>"


def _name(log: Recording) -> str:
    return Path(log.source).name or log.source


def _hash_of_log(log: Recording) -> str:
    """Of its file, or of all files in its folder."""
    path = Path(log.source)
    if path.name == "log.toml":
        path = path.parent
    files = sorted(one for one in path.iterdir() if one.is_file()) if path.is_dir() else [path]
    if not all(file.is_file() for file in files):
        return "from memory"
    size = sum(file.stat().st_size for file in files)
    if size > LARGEST:
        return f"{size / 2**30:.1f} GiB, not hashed"
    digest = hashlib.sha256()
    for file in files:
        with file.open("rb") as opened:
            digest.update(hashlib.file_digest(opened, "sha256").digest())
    return f"sha256 {digest.hexdigest()[:SHOWN]}"


def _sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()
