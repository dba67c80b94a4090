"""A rerun recording with one timeline: the time of the signal."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
import rerun as rr
from numpy.typing import ArrayLike, NDArray

TIMELINE = "time"
APPLICATION = "chatter-monitor"

Clock = Literal["wall", "recording"]


class Stream:
    """Where the views log to.

    Parameters
    ----------
    name : str
        What the viewer calls the recording.
    clock : "wall" or "recording"
        Whether times are seconds since 1970, or since the recording's first sample.
    """

    def __init__(self, name: str, clock: Clock) -> None:
        self.clock = clock
        # Numbers of a recording stand for themselves; who made them is nobody's business.
        self.recording = rr.RecordingStream(APPLICATION, send_properties=False)
        self.recording.set_log_time_enabled(False)  # the signal's time is the only one
        self.recording.set_log_tick_enabled(False)
        self.recording.send_recording_name(name)

    def static(self, path: str, *what: Any) -> None:
        """Log what holds for all times."""
        self.recording.log(path, *what, static=True)

    def at(self, time_s: float, path: str, *what: Any) -> None:
        """Log something at a time."""
        if self.clock == "wall":
            self.recording.set_time(TIMELINE, timestamp=time_s)
        else:
            self.recording.set_time(TIMELINE, duration=time_s)
        self.recording.log(path, *what)

    def series(self, path: str, times_s: ArrayLike, values: NDArray[Any]) -> None:
        """Log rows of numbers, shape (n, series), at n times, in one go."""
        rows = np.asarray(values, np.float64)
        times = np.asarray(times_s, np.float64)
        columns: Iterable[Any] = rr.Scalars.columns(scalars=rows.ravel()).partition([rows.shape[1]] * len(rows))
        if self.clock == "wall":
            column = rr.TimeColumn(TIMELINE, timestamp=np.rint(1e9 * times).astype("datetime64[ns]"))
        else:
            column = rr.TimeColumn(TIMELINE, duration=times)
        self.recording.send_columns(path, indexes=[column], columns=columns)

    def show(self, blueprint: Any) -> None:
        """Arrange the views like this."""
        self.recording.send_blueprint(blueprint)

    def close(self) -> None:
        """Bring out what is buffered."""
        self.recording.flush()
