"""A limit on how often something may happen."""

from __future__ import annotations

from collections.abc import Callable


class TokenBucket:
    """Lets a burst through, and after that no more than a steady rate.

    Parameters
    ----------
    rate_hz : float
        How often a second in the long run.
    burst : int
        How often at once, after a rest.
    clock : callable
        Seconds on a clock that never goes back.
    """

    def __init__(self, rate_hz: float, burst: int, clock: Callable[[], float]) -> None:
        self._rate_hz = rate_hz
        self._burst = burst
        self._clock = clock
        self._tokens = float(burst)
        self._filled_s = clock()

    def take(self) -> bool:
        """Whether it may happen now; counts it if so."""
        now_s = self._clock()
        self._tokens = min(self._burst, self._tokens + (now_s - self._filled_s) * self._rate_hz)
        self._filled_s = now_s
        if self._tokens < 1:
            return False
        self._tokens -= 1
        return True
