"""Parts computed side by side, each in a process of its own.

A part that raises, or whose process dies, costs its own rows and nothing else.
"""

import importlib.util
import multiprocessing
import time
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, cast

from papers.rows import Computed, Judged, Paper, PaperPart, Row, Say, judge, nothing
from twin import stop
from twin.processes import beginning, end_with_parent
from twin.units import span

UNCOMPUTED = "Not computed: no part computes it yet."

_SPAWN = multiprocessing.get_context("spawn")


@dataclass(frozen=True)
class Reproduced:
    """What came out for a paper."""

    paper: Paper
    rows: tuple[Judged, ...]
    """In the order of the file."""
    figures: Mapping[str, str]
    """Caption -> SVG text."""
    failures: tuple[str, ...] = ()
    """A sentence for each part that failed."""


def parts_of(number: str) -> tuple[PaperPart, ...]:
    """What is computed for a paper: `PARTS` of its module, none where it has no module."""
    package = f"papers.paper_{number}"
    if importlib.util.find_spec(package) is None:
        return ()
    return cast("tuple[PaperPart, ...]", importlib.import_module(package).PARTS)


def reproduce(paper: Paper, parts: Sequence[PaperPart], *, jobs: int, say: Say) -> Reproduced:
    """Compute the parts of a paper and judge its rows.

    Args:
        paper: with its rows.
        parts: of this paper.
        jobs: parts at the same time.
        say: told what is being done.

    Raises:
        Stopped: a stop was requested; the parts have ended.
    """
    ours: dict[str, Judged] = {}
    figures: dict[PaperPart, Mapping[str, str]] = {}
    failures: list[str] = []
    by_id = {row.id: row for row in paper.rows}
    for part, result in _computed(parts, jobs, say):
        if isinstance(result, str):
            failures.append(f"{', '.join(part.ids)}: {result}")
            why, result = f"Could not be computed: {result}", Computed({})
        else:
            why = "Not computed: its part gave nothing for it."
        figures[part] = result.figures
        for name in part.ids:
            ours[name] = _judged(by_id[name], result, why)
    return Reproduced(
        paper,
        tuple(ours.get(row.id) or nothing(row, UNCOMPUTED) for row in paper.rows),
        {caption: svg for part in parts for caption, svg in figures[part].items()},
        tuple(failures),
    )


def _judged(row: Row, computed: Computed, why: str) -> Judged:
    if row.id not in computed.rows:
        return nothing(row, why)
    try:
        return judge(row, computed.rows[row.id])
    except ValueError as problem:
        return nothing(row, f"Cannot be judged: {problem}.")


def _computed(
    parts: Iterable[PaperPart], jobs: int, say: Say
) -> Iterator[tuple[PaperPart, Computed | str]]:
    """Each part with what it found, or with a sentence on why it found nothing."""
    waiting, running = deque(parts), dict[Any, tuple[PaperPart, BaseProcess]]()
    total, done, began = len(waiting), 0, time.monotonic()
    try:
        while waiting or running:
            while waiting and len(running) < jobs:
                part = waiting.popleft()
                ours, theirs = _SPAWN.Pipe(duplex=False)
                process = _SPAWN.Process(target=_work, args=(part, theirs), daemon=True)
                with beginning():
                    process.start()
                theirs.close()
                running[ours] = part, process
            stop.check()
            for pipe in cast("list[Connection]", wait(list(running), stop.LOOK)):
                part, process = running[pipe]
                answer = _received(pipe, process)
                if answer is None:
                    continue
                kind, content = answer
                if kind == "say":
                    say(f"{part.ids[0]}: {content}")
                    continue
                del running[pipe]
                process.join()
                done += 1
                left = (time.monotonic() - began) * (total - done) / done
                say(f"{done} of {total}: {part.ids[0]} {kind}, about {span(left)} left")
                yield part, content
    finally:
        for _, process in running.values():
            process.kill()
            process.join()


def _received(pipe: "Connection", process: BaseProcess) -> tuple[str, Any] | None:
    try:
        return pipe.recv()
    except EOFError:
        process.join()
        return "failed", f"its process ended with code {process.exitcode}"


def _work(part: PaperPart, pipe: "Connection") -> None:
    """In the part's process."""
    end_with_parent()
    try:
        computed = part.compute(lambda doing: pipe.send(("say", doing)))
    except Exception as problem:
        pipe.send(("failed", f"{type(problem).__name__}: {problem}"))
    else:
        pipe.send(("done", computed))
    pipe.close()
