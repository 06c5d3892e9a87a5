"""What an estimator is: samples in, one `Estimate` out, for one run or a thousand."""

import abc

from twin.platform import Platform
from twin.signals import Estimate, Reading


class Estimator(abc.ABC):
    """A frozen dataclass of settings; what it remembers is the `Estimate` itself (or a subclass)."""

    @abc.abstractmethod
    def init(self, platform: Platform, n: int) -> Estimate:
        """The estimate before the first sample; `valid` is False."""

    @abc.abstractmethod
    def update(self, estimate: Estimate, reading: Reading) -> Estimate:
        """The estimate at `reading.time`, from all samples that arrived since the last one."""
