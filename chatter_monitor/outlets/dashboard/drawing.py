"""The dashboard as an outlet of a monitor in the same process, for recordings."""

from __future__ import annotations

from chatter_monitor.outlets.dashboard.screen import Screen
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.outlets.signal_view import SignalView
from chatter_monitor.records import Announcement, Block, Odp, OdpFrame
from chatter_monitor.tracking.orders import Orders


class Drawing(Outlet):
    """Draws the results of a replay.

    Parameters
    ----------
    screen : Screen
        On what; closing the outlet closes it.
    """

    def __init__(self, screen: Screen) -> None:
        self._screen = screen
        self._view = SignalView()

    def block(self, block: Block) -> None:
        """Keep the samples until the frames that they complete come."""
        self._view.block(block)

    def turning(self, channel: int, orders: Orders) -> None:
        """Keep what turned for the frame that comes next."""
        self._view.turning(channel, orders)

    def frame(self, frame: OdpFrame, odp: Odp) -> None:  # noqa: ARG002  the frame has every sample
        """Draw modes and signal of an interval."""
        self._screen.odp(frame)
        signal = self._view.frame(frame)
        if signal is not None:
            self._screen.signal(signal)

    def message(self, message: Announcement) -> None:
        """Draw a message."""
        self._screen.message(message)

    def close(self) -> None:
        """Bring out what is buffered."""
        self._screen.close()
