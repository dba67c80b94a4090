"""What speaks for something, summed until it is certain (Page, Continuous inspection schemes, Biometrika 41 (1954))."""

from __future__ import annotations


class CumulativeSum:
    """A sum that is never below 0, nor above what is enough.

    Parameters
    ----------
    enough : float
        At this it is certain, until the sum is 0 again.
    """

    def __init__(self, enough: float) -> None:
        self._enough = enough
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._sum, self._certain = 0.0, False

    def add(self, telling: float) -> None:
        """Take what speaks for it, or, if negative, against it."""
        self._sum = min(max(self._sum + telling, 0.0), self._enough)
        self._certain = self._sum >= self._enough or (self._certain and self._sum > 0.0)

    @property
    def certain(self) -> bool:
        """Whether it is."""
        return self._certain
