"""Hidden effects, many times: how often is the cause named, and sized as it should be?

`make panel` hides, diagnoses, adds a line a case to docs/diagnosis.jsonl and then writes
docs/diagnosis.md from whatever is there. What is there is not done again: it grows with each run,
and one that is killed loses a case of each worker at most. By itself:

    python tests/promises/panel.py --kinds single,null --evidence 60 --cases 20 --jobs 2

As the code goes on, the oldest answers are its own no more: `--anew 20` does the 20 cases again
that were done longest ago, whatever came out, and replaces them.

Cases are numbered. Those from 1000 on have logs of 300 s at 100 Hz: `--kinds single --first 1000`.
"""

import argparse
import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

for _one in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"):
    os.environ.setdefault(_one, "1")
sys.path.insert(0, str(Path(__file__).parent))

from case import KINDS, Case, run  # noqa: E402
from page import page, rows_of  # noqa: E402

from twin import stop  # noqa: E402
from twin.files import write_whole  # noqa: E402
from twin.processes import Pool, first_completed  # noqa: E402

PAGE = Path(__file__).parents[2] / "docs" / "diagnosis.md"
ROWS = PAGE.with_suffix(".jsonl")
CASES_EACH = 20
"""Of a process, which keeps every bench that it has met."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rows", type=Path, default=ROWS, help="a case a line")
    parser.add_argument("--kinds", default=",".join(KINDS), help="of what is hidden")
    parser.add_argument("--evidence", default="", help="only of so much")
    parser.add_argument("--cases", type=int, default=10, help="of each kind and evidence")
    parser.add_argument("--first", type=int, default=0, help="number of the first")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--anew", type=int, help="do so many again, the oldest, and no others")
    options = parser.parse_args()
    there = [Case(row["kind"], row["evidence"], row["seed"]) for row in rows_of(options.rows)]
    new = [case for case in cases(options) if case not in there]
    todo = new if options.anew is None else there[: options.anew]
    print(f"{len(todo)} cases to do", flush=True)
    done = 0
    with options.rows.open("a", encoding="utf-8") as rows:
        for batch in batched(todo, CASES_EACH * options.jobs):
            for case, row in ran(batch, options.jobs):
                rows.write(json.dumps(row) + "\n")
                rows.flush()
                done += 1
                print(f"{done}/{len(todo)} {case.name}: {told(row)}", flush=True)
    rows = rows_of(options.rows)
    write_whole(options.rows, "".join(json.dumps(row) + "\n" for row in rows))
    write_whole(PAGE, page(rows))
    print(PAGE.read_text(encoding="utf-8"))
    return 0


def batched(every: list[Case], size: int) -> list[list[Case]]:
    """In their order."""
    return [every[first : first + size] for first in range(0, len(every), size)]


def ran(every: list[Case], jobs: int) -> Iterator[tuple[Case, dict[str, Any]]]:
    """Each with its row, as it comes, in processes that end with them.

    Fresh ones for each batch: `max_tasks_per_child` leaves a pool without any (Python 3.11).
    """
    with Pool(jobs) as pool:
        futures = {pool.submit(run, case): case for case in every}
        while futures:
            for future in first_completed(futures):
                yield futures.pop(future), future.result()


def cases(options: argparse.Namespace) -> list[Case]:
    """Number by number, so that a run that is ended early has some of everything."""
    wanted = [int(one) for one in options.evidence.split(",") if one]
    return [
        Case(kind, evidence, seed)
        for seed in range(options.first, options.first + options.cases)
        for kind in options.kinds.split(",")
        for evidence in KINDS[kind]
        if not wanted or evidence in wanted
    ]


def told(row: dict[str, Any]) -> str:
    """How a case went."""
    if "failed" in row:
        return "failed: " + row["failed"].strip().splitlines()[-1]
    return row.get("skipped") or f"{row['verdict']} in {row['seconds']:.0f} s"


if __name__ == "__main__":
    stop.listen()
    stop.keeps(lambda: "the rows so far are kept; the same command goes on")
    try:
        raise SystemExit(main())
    except stop.Stopped as request:
        print(f"{request}; {stop.kept()}", file=sys.stderr)
        raise SystemExit(request.status) from None
