"""What the monitor asks of everything that takes results: a file, a table, a socket."""

from __future__ import annotations

from types import TracebackType
from typing import Protocol, Self

from chatter_monitor.records import Announcement, Block, Odp, OdpFrame
from chatter_monitor.tracking.orders import Orders
from chatter_monitor.tracking.spindle import SpindleSettings


class Outlet(Protocol):
    """Takes the results of all channels in order of time; one thread owns it.

    Use it as a context manager: leaving by an exception lets an outlet discard what is worth nothing incomplete.
    """

    def block(self, block: Block) -> None:  # noqa: ARG002  most outlets have no use for it
        """Take samples of all channels at the tracker's rate, before the frames that they complete come."""
        return

    def spindle(self, spindle: SpindleSettings) -> None:  # noqa: ARG002  most outlets have no use for it
        """Take note that from the next verdict on the spindle is taken to turn like this."""
        return

    def turning(self, channel: int, orders: Orders) -> None:  # noqa: ARG002  most outlets have no use for it
        """Take note of what turned in the interval of a channel whose frame comes next."""
        return

    def frame(self, frame: OdpFrame, odp: Odp) -> None:
        """Take one verdict interval of one channel: every sample, and the summary, which has all mode slots."""

    def message(self, message: Announcement) -> None:
        """Take one message of the public contract."""

    def digest(self) -> None:
        """Do what is left of the frames taken, now that the verdicts on all channels are out; so it is before closing.

        An outlet whose frames take long leaves them for this moment, because in `frame` they would hold up verdicts.
        """
        return

    def problems(self) -> list[str]:
        """What is wrong with this outlet at the moment, as reasons for the health message."""
        return []

    def close(self) -> None:
        """Bring out what is still buffered and let go of the resource; a second call does nothing."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()
