"""The error of an effect; the constructor takes the whole sentence."""

from twin.errors import UsageError


class EffectError(UsageError):
    """An effect with a wrong value, or one that a platform cannot have."""
