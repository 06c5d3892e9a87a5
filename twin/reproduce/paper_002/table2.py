"""Table 2: the paper's methods on perfect data."""

from twin.reproduce.paper_002.manoeuvre import ideal, machine
from twin.reproduce.paper_002.methods import METHODS, errors, largest
from twin.reproduce.part import Computed, Ours, PaperPart, Say

NOTE = (
    "The paper blames its first-order integration; ours is the trapezoidal rule at the same 0.02 s."
)


def compute(say: Say) -> Computed:
    """One flight, four methods."""
    say("Table 2: perfect data")
    log, platform = ideal().without_truth(), machine()
    return Computed(
        {f"002.table2.{m}": Ours(largest(errors(log, platform, m)), note=NOTE) for m in METHODS}
    )


PART = PaperPart(tuple(f"002.table2.{method}" for method in METHODS), compute)
