"""A process that works for this one and talks to it through a pipe."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context, resource_tracker
from typing import Any


class Worker:
    """Started anew, and ended by whoever started it. When that is gone its end of the pipe says so.

    Parameters
    ----------
    target : callable
        What it does; of its end of the pipe, and the arguments.
    *arguments
        Pickled.

    Attributes
    ----------
    pipe : Connection
        The end here.
    """

    def __init__(self, target: Callable[..., None], *arguments: object) -> None:
        context = get_context("spawn")  # threads and compiled code do not survive a fork
        self.pipe, other = context.Pipe()
        self._process = context.Process(target=target, args=(other, *arguments), daemon=True)
        resource_tracker.ensure_running()  # to start that lets interrupts through again
        # A terminal interrupts all; this one inherits, from its first moment on, that it is not to mind.
        minded = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        self._process.start()
        signal.pthread_sigmask(signal.SIG_SETMASK, minded)
        other.close()

    @property
    def alive(self) -> bool:
        """Whether it is."""
        return self._process.is_alive()

    @property
    def exit_code(self) -> int | None:
        """How it ended; waits until it has."""
        self._process.join()
        return self._process.exitcode

    def send(self, item: object) -> None:
        """Send it something; if it has died, `receive` finds out."""
        with suppress(OSError):
            self.pipe.send(item)

    def receive(self) -> Any:
        """What it has sent, which is never None; None if it has died."""
        try:
            return self.pipe.recv()
        except (EOFError, OSError):
            return None

    def stop(self) -> None:
        """End it, whatever it does."""
        self._process.kill()
        self._process.join()
        self.pipe.close()
