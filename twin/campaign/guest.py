"""What a worker of a cluster does: fly a shard of a campaign that was sent, and send back its rows.

The worker may be any machine with this package; nothing of the campaign is written there.
"""

import socket
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock

import pyarrow as pa

from twin.campaign.arithmetic import arithmetic
from twin.campaign.parcel import unpacked
from twin.campaign.spec import Spec
from twin.campaign.worker import Done, rows_of_shard
from twin.errors import TwinError

_one_at_a_time = Lock()
"""Flights of one process share caches; a worker with threads flies no faster for them."""


@dataclass(frozen=True)
class Sent:
    """A shard that is flown and not yet written."""

    done: Done
    rows: pa.Table
    arithmetic: str
    """The mark of who flew it."""


@dataclass(frozen=True)
class Refused:
    """Why it cannot be flown there, and where that is."""

    host: str
    sentence: str


def fly_sent(campaign: bytes, shard: int) -> Sent | Refused:
    """Fly a shard of a packed campaign."""
    try:
        with _one_at_a_time:
            spec, _ = _opened(campaign)
            return Sent(*rows_of_shard(spec, shard), arithmetic())
    except (TwinError, OSError) as problem:
        return Refused(socket.gethostname(), str(problem))


@lru_cache(maxsize=2)
def _opened(campaign: bytes) -> tuple[Spec, TemporaryDirectory[str]]:
    """Once a process; the folder is there as long as the campaign is remembered."""
    folder = TemporaryDirectory(prefix="twin-campaign-", ignore_cleanup_errors=True)
    return unpacked(campaign, Path(folder.name)), folder
