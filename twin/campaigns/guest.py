"""What a worker of a cluster does: fly a shard of a campaign that was sent, and send back its rows.

The worker may be any machine with this package; nothing of the campaign is written there.
"""

import socket
from collections import OrderedDict
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Lock

import pyarrow as pa

from twin.campaigns.arithmetic import arithmetic
from twin.campaigns.parcel import unpacked
from twin.campaigns.spec import Spec
from twin.campaigns.worker import Done, rows_of_shard
from twin.errors import TwinError

_REMEMBERED = 2
"""Campaigns whose files are kept."""

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
            return Sent(*rows_of_shard(_opened(campaign), shard), arithmetic())
    except (TwinError, OSError) as problem:
        return Refused(socket.gethostname(), str(problem))


_campaigns: OrderedDict[bytes, tuple[Spec, TemporaryDirectory[str]]] = OrderedDict()
"""Opened ones by what was sent, the one used last at the end."""


def _opened(campaign: bytes) -> Spec:
    """Once a process; its folder is there as long as the campaign is remembered."""
    if campaign not in _campaigns:
        folder = TemporaryDirectory(prefix="twin-campaign-", ignore_cleanup_errors=True)
        try:
            spec = unpacked(campaign, Path(folder.name))
        except BaseException:
            folder.cleanup()
            raise
        _campaigns[campaign] = spec, folder
    _campaigns.move_to_end(campaign)
    while len(_campaigns) > _REMEMBERED:
        _, (_, oldest) = _campaigns.popitem(last=False)
        oldest.cleanup()
    return _campaigns[campaign][0]
