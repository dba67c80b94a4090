"""What the service manager wants to know: ready, alive, how it goes (sd_notify(3), without its library)."""

from __future__ import annotations

import logging
import socket
from collections.abc import Mapping
from types import TracebackType
from typing import Self

from chatter_monitor.errors import EnvironmentFault

# A service manager that takes longer than this is in trouble itself; the monitor goes on listening.
SEND_TIMEOUT_S = 0.2

_log = logging.getLogger(__name__)


class Notifier:
    """Tells systemd about this process. Without systemd every method does nothing.

    A message that cannot be delivered is logged and forgotten: monitoring is more important than reporting, and a
    manager that misses READY or the watchdog's food acts by itself. One thread owns it.

    Parameters
    ----------
    address : str or None
        Path of the notification socket, or its abstract name after ``@``; None where nobody asked.
    watchdog_s : float or None
        Within which time of the last `watchdog` the manager kills this process; None where it does not.

    Attributes
    ----------
    watchdog_s : float or None
        As given. Feed it at half of this or more often.

    Raises
    ------
    EnvironmentFault
        If the address is not one of a datagram socket of this machine.
    """

    def __init__(self, address: str | None, watchdog_s: float | None = None) -> None:
        self.watchdog_s = watchdog_s
        self._socket: socket.socket | None = None
        if address is None:
            return
        if address[:1] not in ("/", "@"):
            raise EnvironmentFault(
                "NOTIFY_SOCKET is no socket of this machine", got=address, allowed="an absolute path, or @ and a name"
            )
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC)
        self._socket.settimeout(SEND_TIMEOUT_S)
        self._address = "\0" + address[1:] if address.startswith("@") else address

    @classmethod
    def from_environment(cls, environment: Mapping[str, str], pid: int) -> Self:
        """Notifier as the service manager asked for it.

        Parameters
        ----------
        environment : mapping
            NOTIFY_SOCKET, WATCHDOG_USEC and WATCHDOG_PID are looked at, such as those of `os.environ`.
        pid : int
            Of this process: a watchdog that is meant for another one is not fed.

        Raises
        ------
        EnvironmentFault
            If a variable has a value that systemd would not give it.
        """
        watchdog_us = environment.get("WATCHDOG_USEC")
        watchdog_s: float | None = None
        if watchdog_us is not None and environment.get("WATCHDOG_PID", str(pid)) == str(pid):
            if not watchdog_us.isdecimal() or int(watchdog_us) == 0:
                raise EnvironmentFault("WATCHDOG_USEC is no time", got=watchdog_us, allowed="microseconds above 0")
            watchdog_s = int(watchdog_us) / 1e6
        return cls(environment.get("NOTIFY_SOCKET") or None, watchdog_s)

    def ready(self, status: str | None = None) -> None:
        """Tell that the service does its work: after the start, and again after `reloading`."""
        self._send("READY=1", *_status(status))

    def watchdog(self) -> None:
        """Feed the watchdog. Only progress with samples is a reason to do so."""
        self._send("WATCHDOG=1")

    def status(self, text: str) -> None:
        """Tell how it goes, as a sentence for a person (``systemctl status``)."""
        self._send(*_status(text))

    def stopping(self, status: str | None = None) -> None:
        """Tell that the service is on its way out."""
        self._send("STOPPING=1", *_status(status))

    def reloading(self, monotonic_us: int) -> None:
        """Tell that the configuration is being read again; `ready` ends it.

        Parameters
        ----------
        monotonic_us : int
            CLOCK_MONOTONIC in microseconds when the reload began, by which systemd tells an old message from a new one.
        """
        self._send("RELOADING=1", f"MONOTONIC_USEC={monotonic_us}")

    def close(self) -> None:
        """Let go of the socket; may be called more than once."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _send(self, *assignments: str) -> None:
        if self._socket is None:
            return
        try:
            self._socket.sendto("\n".join(assignments).encode(), self._address)
        except OSError as error:
            _log.warning("systemd does not hear us: %s", error)


def _status(text: str | None) -> tuple[str, ...]:
    """Assignment of a status, which is one line whatever is in it: the next line would be an assignment of its own."""
    return () if text is None else ("STATUS=" + " ".join(text.split()),)
