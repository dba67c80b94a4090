"""What a person is told when the kernels have to be compiled first."""

from __future__ import annotations

from chatter_monitor.kernels import is_compiled


def what_takes_long() -> str | None:
    """What the next run does before anything else, and for how long; None where that has been done."""
    if is_compiled():
        return None
    return "compiling the kernels for this machine; this happens once and takes about a minute"
