"""Front ends in a process of their own, a few blocks ahead of the monitor.

Arrays go from one process to the other through memory that both see: a pipe takes five times as long for them, and
whoever sends what a pipe does not hold has to wait until it is taken.
"""

from __future__ import annotations

import ctypes
import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from multiprocessing.connection import Connection
from multiprocessing.sharedctypes import RawArray
from types import TracebackType
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.config import Settings
from chatter_monitor.errors import EnvironmentFault
from chatter_monitor.records import OdpFrame
from chatter_monitor.service.front_ends import FrontEndsHere, Taken
from chatter_monitor.service.worker import Worker
from chatter_monitor.tracking.front_end import Tracked
from chatter_monitor.tracking.orders import Orders

AnyArray = NDArray[Any]

# The two processes take turns at being the slower one: so many blocks may be on their way.
UNDER_WAY = 8
# Of the signal, of a mode's ODPs at one sample, and of the long spectra for each sample, at most.
_BYTES_OF_SAMPLE, _BYTES_OF_MODE, _BYTES_OF_SPECTRA = 8, 17, 8
_ALIGNED = 64  # bytes: an array begins at a multiple of this
_SLACK = 1.25  # an interval may begin before its block, and each array has a little besides
_NO_SAMPLES = np.empty((0, 0))
_FIELDS = tuple(field.name for field in fields(OdpFrame))


class FrontEndsAhead:
    """As `FrontEndsHere`, to the last bit, but a long recording takes little more than half of the time.

    Use it as a context manager.

    Parameters
    ----------
    settings, channels, source_rate_hz
        As of `FrontEndsHere`.
    block_samples : int
        Of most blocks, at most; what is longer takes longer.
    """

    def __init__(self, settings: Settings, channels: int, source_rate_hz: float, block_samples: int) -> None:
        room = round(_SLACK * UNDER_WAY * channels * block_samples)
        frames = _BYTES_OF_SAMPLE + settings.tracker.modes * _BYTES_OF_MODE + _BYTES_OF_SPECTRA
        self._there = _Shared(RawArray(ctypes.c_uint8, room * _BYTES_OF_SAMPLE))
        self._back = _Shared(RawArray(ctypes.c_uint8, room * frames))
        self._worker = Worker(_serve, self._there, self._back, settings, channels, source_rate_hz)

    def through(self, taken: Iterable[Taken]) -> Iterator[tuple[Taken, list[list[Tracked]]]]:
        """As of `FrontEnds`; raises an `EnvironmentFault` if the process dies."""
        under_way: deque[Taken] = deque()
        for each in taken:
            # What fits into the shared memory leaves so little for the pipe that no sender waits. For the rest the
            # other side has to be ready to take it.
            while len(under_way) == UNDER_WAY or (under_way and not self._there.fits(each.block.samples)):
                yield under_way.popleft(), self._results()
            self._there.begin_message()
            place = self._there.put([each.block.samples])
            self._worker.send((replace(each.block, samples=_NO_SAMPLES), place, each.spindle))
            under_way.append(each)
        while under_way:
            yield under_way.popleft(), self._results()

    def finish(self) -> list[list[Tracked]]:
        """As of `FrontEnds`."""
        self._worker.send(None)
        return self._results()

    def digest(self) -> None:
        """As of `FrontEnds`: nothing, because nobody waits there."""

    def _results(self) -> list[list[Tracked]]:
        answer: list[_Intervals] | None = self._worker.receive()
        if answer is None:
            raise EnvironmentFault(
                "the second process of the replay died",
                got=f"exit code {self._worker.exit_code}",
                remedy="Is there enough memory? Replay again.",
            )
        self._back.begin_message()
        return [intervals.unpacked(self._back) for intervals in answer]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._worker.stop()


class _Place(NamedTuple):
    """Where arrays of one shape lie in a part of the shared memory."""

    begin: int
    shape: tuple[int, ...]
    kind: np.dtype[Any]

    @property
    def end(self) -> int:
        return self.begin + math.prod(self.shape) * self.kind.itemsize


class _Shared:
    """Memory that two processes see, in as many parts as messages may be on their way; each has its turn.

    Parameters
    ----------
    memory : ctypes array of c_uint8
        The memory.
    """

    def __init__(self, memory: Any) -> None:
        self._memory = memory
        self._size = len(memory) // UNDER_WAY // _ALIGNED * _ALIGNED
        self._message = -1
        self._end = 0  # of what has been put in this part

    def begin_message(self) -> None:
        """Go on to the next part."""
        self._message += 1
        self._end = 0

    def fits(self, array: AnyArray) -> bool:
        """Whether an array fits into a part."""
        return array.nbytes <= self._size

    def put(self, arrays: Sequence[AnyArray]) -> _Place | AnyArray:
        """Put arrays of one shape in this part and tell where; or return them as one, if there is no room."""
        begin = -(-self._end // _ALIGNED) * _ALIGNED
        place = _Place(begin, (len(arrays), *arrays[0].shape), arrays[0].dtype)
        if place.end > self._size:
            return np.stack(arrays)
        np.stack(arrays, out=self._at(place))
        self._end = place.end
        return place

    def get(self, place: _Place | AnyArray) -> AnyArray:
        """Return what was put, for keeps: the part will be used again."""
        return self._at(place).copy() if isinstance(place, _Place) else place

    def _at(self, place: _Place) -> AnyArray:
        begin = self._message % UNDER_WAY * self._size + place.begin
        return np.ndarray(place.shape, place.kind, self._memory, begin)


class _Intervals(NamedTuple):
    """Intervals of a channel: what turned in each, and each field of all their frames, arrays of all of them in one.

    And the long spectra, which some of them have.
    """

    orders: list[Orders]
    fields: list[Any]
    with_spectrum: list[int]
    spectra: _Place | AnyArray

    @classmethod
    def packed(cls, tracked: list[Tracked], shared: _Shared) -> _Intervals:
        """Put arrays into shared memory, transposed: so they lie in the memory of a frame."""
        packed: list[Any] = []
        for name in _FIELDS if tracked else ():
            values = [getattr(odp, name) for odp, _ in tracked]
            packed.append(shared.put([v.T for v in values]) if isinstance(values[0], np.ndarray) else values)
        spectra = {i: orders.spectrum for i, (_, orders) in enumerate(tracked) if orders.spectrum is not None}
        orders = [orders._replace(spectrum=None) for _, orders in tracked]
        return cls(orders, packed, list(spectra), shared.put(list(spectra.values())) if spectra else _NO_SAMPLES)

    def unpacked(self, shared: _Shared) -> list[Tracked]:
        """Take them out."""
        orders = self.orders.copy()
        for i, spectrum in zip(self.with_spectrum, shared.get(self.spectra), strict=True):
            orders[i] = orders[i]._replace(spectrum=spectrum)
        columns = [packed if isinstance(packed, list) else [v.T for v in shared.get(packed)] for packed in self.fields]
        return [Tracked(OdpFrame(*values), orders) for orders, *values in zip(orders, *columns, strict=True)]


def _serve(
    pipe: Connection, there: _Shared, back: _Shared, settings: Settings, channels: int, source_rate_hz: float
) -> None:
    front_ends = FrontEndsHere(settings, channels, source_rate_hz)

    def answer(channels: Iterable[list[Tracked]]) -> None:
        back.begin_message()
        pipe.send([_Intervals.packed(tracked, back) for tracked in channels])

    with suppress(EOFError, OSError):  # who started this is gone
        while (work := pipe.recv()) is not None:
            block, place, spindle = work
            there.begin_message()
            answer(front_ends.track(replace(block, samples=there.get(place)[0]), spindle))
        answer(front_ends.finish())
