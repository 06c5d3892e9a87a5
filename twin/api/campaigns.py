"""Campaigns: thousands of runs, what they will take, what came of them, one of them again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from twin.api.inputs import Say, silent

if TYPE_CHECKING:
    from twin.campaigns.answers import Answers
    from twin.campaigns.execute import CampaignRuns, Forecast
    from twin.campaigns.replay import Replayed


def campaign(
    spec: str | Path,
    folder: str | Path,
    *,
    workers: int = 1,
    cluster: str = "",
    resume: bool = False,
    trust: Sequence[str | Path] = (),
    say: Say = silent,
) -> Answers:
    """Fly thousands of closed-loop runs that differ as a file says, and say what came of them.

    Called from a script, several workers need its `if __name__ == "__main__":`.

    Args:
        spec: the file (docs/campaigns.md).
        folder: where the results go.
        workers: processes; the results do not depend on it.
        cluster: address of a Dask scheduler, `tcp://HOST:PORT`, whose workers fly instead.
        resume: go on with what the folder holds.
        trust: folders whose laws and effects, which are programs, the file may name.
        say: takes the progress.

    Returns:
        Distributions, sensitivities and comparisons; `.results` has the runs as columns.

    Raises:
        CampaignError: a specification or a folder that cannot be used.
    """
    fly_campaign(
        spec, folder, workers=workers, cluster=cluster, resume=resume, trust=trust, say=say
    )
    return results(folder)


def fly_campaign(
    spec: str | Path,
    folder: str | Path,
    *,
    workers: int = 1,
    cluster: str = "",
    resume: bool = False,
    trust: Sequence[str | Path] = (),
    say: Say = silent,
) -> CampaignRuns:
    """As `campaign`, without its answers: how many runs were flown, and how they ended."""
    from twin.campaigns.execute import fly_spec
    from twin.campaigns.folder import Folder
    from twin.campaigns.read import read_spec
    from twin.files import trust_folders

    _check_workers(workers)
    trust_folders(*map(Path, trust))
    stated = read_spec(Path(spec))
    return fly_spec(
        stated, Folder(Path(folder)), workers=workers, cluster=cluster, resume=resume, tell=say
    )


def forecast(spec: str | Path, *, workers: int = 1, trust: Sequence[str | Path] = ()) -> Forecast:
    """What a campaign will take: runs, time and disk, measured on a short probe in this process.

    Args:
        spec: the file (docs/campaigns.md).
        workers: processes that will fly it.
        trust: folders whose laws and effects, which are programs, the file may name.

    Raises:
        CampaignError: a specification that cannot be used.
    """
    from twin.campaigns.execute import forecast as forecast_spec
    from twin.campaigns.read import read_spec
    from twin.files import trust_folders

    _check_workers(workers)
    trust_folders(*map(Path, trust))
    return forecast_spec(read_spec(Path(spec)), workers)


def results(
    folder: str | Path,
    against: str | Path | None = None,
    *,
    trust: Sequence[str | Path] = (),
    say: Say = silent,
) -> Answers:
    """What came of a campaign so far, beside another one.

    Args:
        folder: of the campaign.
        against: of the other one.
        trust: folders whose laws and effects, which are programs, the file may name.
        say: takes the progress.

    Raises:
        CampaignError: no campaign, or nothing of it yet.
    """
    from twin.campaigns.answers import answers
    from twin.campaigns.results import read_results
    from twin.files import trust_folders

    trust_folders(*map(Path, trust))
    flown = read_results(Path(folder))
    other = None if against is None else read_results(Path(against))
    say("computing")
    return answers(flown, other)


def replay(
    folder: str | Path,
    run: int,
    *,
    rrd: str | Path | None = None,
    trust: Sequence[str | Path] = (),
) -> Replayed:
    """One run of a campaign again, to the same bits.

    Args:
        folder: of the campaign.
        run: its number, from 0.
        rrd: record into this file.
        trust: folders whose laws and effects, which are programs, the file may name.

    Raises:
        UsageError: the campaign has no such run, or `rrd` cannot be written.
    """
    from twin.campaigns.folder import Folder
    from twin.campaigns.read import read_spec
    from twin.campaigns.replay import replay as replay_run
    from twin.files import check_writable, trust_folders

    where, path = Folder(Path(folder)), None if rrd is None else Path(rrd)
    if path is not None:
        check_writable(path, ".rrd")
    trust_folders(*map(Path, trust))
    spec = read_spec(where.spec)
    where.check_spec()
    return replay_run(spec, where, run, path)


def _check_workers(workers: int) -> None:
    from twin.errors import UsageError

    if workers < 1:
        raise UsageError(f"workers is {workers}; give 1 or more")
