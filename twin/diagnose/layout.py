"""Where the strengths of an explanation stand in its problem."""

from dataclasses import dataclass
from itertools import accumulate, pairwise


@dataclass(frozen=True)
class Layout:
    """First where springs rest, then what no log shows of each effect, then the components of each
    that were fitted, then the coefficients of laws."""

    rests: int
    hidden: tuple[int, ...]
    """Components of each effect."""
    free: tuple[int, ...]
    """Components of each effect."""
    laws: int

    @property
    def count(self) -> int:
        """Of all."""
        return self.rests + sum(self.hidden) + sum(self.free) + self.laws

    @property
    def of_hidden(self) -> list[slice]:
        """By effect."""
        return _slices(self.rests, self.hidden)

    @property
    def of_free(self) -> list[slice]:
        """By effect."""
        return _slices(self.rests + sum(self.hidden), self.free)

    @property
    def of_laws(self) -> slice:
        """All of them."""
        return slice(self.count - self.laws, self.count)

    @property
    def own(self) -> slice:
        """By what the model differs from one without effects and laws: free components, laws."""
        return slice(self.rests + sum(self.hidden), self.count)


def _slices(first: int, counts: tuple[int, ...]) -> list[slice]:
    return [slice(*ends) for ends in pairwise(accumulate(counts, initial=first))]
