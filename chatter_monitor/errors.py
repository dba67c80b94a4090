"""Errors that speak: what went wrong, what was got, what is allowed, and what to do about it."""

from __future__ import annotations


class ChatterMonitorError(Exception):
    """Base of all errors that are shown to a user in one or two lines.

    Parameters
    ----------
    what : str
        What is wrong, as a sentence without a full stop.
    got : object, optional
        The offending value.
    allowed : str, optional
        What would have been accepted.
    remedy : str, optional
        What the user can do about it.
    """

    exit_code = 1

    def __init__(self, what: str, *, got: object = None, allowed: str | None = None, remedy: str | None = None) -> None:
        self.what = what
        self.got = got
        self.allowed = allowed
        self.remedy = remedy
        super().__init__(str(self))

    def __str__(self) -> str:
        parts = [self.what]
        if self.got is not None:
            parts.append(f"got {self.got!r}")
        if self.allowed is not None:
            parts.append(f"allowed: {self.allowed}")
        text = "; ".join(parts) + "."
        return f"{text} {self.remedy}" if self.remedy else text


class InputError(ChatterMonitorError):
    """What the user gave cannot be used: a file, an option, a configuration key."""

    exit_code = 2


class EnvironmentFault(ChatterMonitorError):
    """The machine lacks something that the user did not choose: a device, a port, room on a disk."""

    exit_code = 3
