"""Where a line of reasoning stands: an explanation, and what is weighed from there."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

from twin.diagnose.candidates import Candidate
from twin.diagnose.explanation import Explanation
from twin.diagnose.laws import laws_of, unlikely
from twin.diagnose.remainder import Remainder, remainder
from twin.diagnose.search import Search
from twin.identify.prediction_error import WORTHWHILE


@dataclass(frozen=True)
class Line:
    """Where a line of reasoning ends."""

    now: Explanation
    search: Search
    """Where it stands."""
    asked: tuple[Candidate, ...]
    """What it weighs beside the explanation's own parts."""
    nameless: float = 0.0
    """Evidence that laws without a name brought beyond the catalogue's causes; 0 without any."""
    rivals: Mapping[str, float] = field(default_factory=dict[str, float])
    """By how much causes that were fitted in an only one's place are behind, by label."""

    @cached_property
    def left(self) -> Remainder:
        """What it does not explain."""
        return remainder(self.now)

    @property
    def score(self) -> float:
        """-2 log L, and the price of all that was set to have it so; the lower the better."""
        own = self.now.own
        price = self.search.weighing.weigh(own).gain - self.search.evidence(own)
        if self.now.laws:
            price += len(self.now.laws) * unlikely(laws_of(self.now.bodies))
        price += WORTHWHILE * self.now.noise.processes
        return self.now.cost + price


def search_from(now: Explanation, asked: Sequence[Candidate]) -> Search:
    """Among an explanation's own parts and all that can be asked."""
    weighing = now.weighing(asked)
    return Search(weighing, range(len(weighing.traces)))
