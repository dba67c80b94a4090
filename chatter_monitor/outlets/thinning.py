"""Which messages go on to a plant's network, where one a second of a kind is plenty."""

from __future__ import annotations

from chatter_monitor.outlets.wire import topic_of
from chatter_monitor.records import Event, Health, Mismatch, OdpFrame, SignalFrame, Verdict


class Thinning:
    """Lets through what is new: each change of state at once, the same state once in a while, every event.

    Parameters
    ----------
    every_s : float
        Seconds of signal after which the same state is told again; 0 for every message.
    """

    def __init__(self, every_s: float) -> None:
        self._every_s = every_s
        self._last: dict[str, tuple[str, float]] = {}

    def passed(
        self, message: OdpFrame | SignalFrame | Verdict | Event | Health | Mismatch
    ) -> Verdict | Event | Health | Mismatch | None:
        """Return the message if it goes on; frames never do."""
        match message:
            case Event() | Mismatch():
                return message
            case Verdict():
                now = message.t1
            case Health():
                now = message.t
            case _:
                return None
        state, since = self._last.get(topic_of(message), ("", 0.0))
        # A monitor that starts anew begins at 0.
        if message.state == state and since <= now < since + self._every_s:
            return None
        self._last[topic_of(message)] = (message.state, now)
        return message
