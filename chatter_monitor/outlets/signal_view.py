"""The signal as a person may look at it: extremes and spectrum of each interval, before anything is taken out."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.records import Block, Flag, OdpFrame, SignalFrame
from chatter_monitor.tracking.orders import Orders

# Short enough to show a tooth's impact, long enough for a screen: 200 pairs a second.
PART_S = 0.005
# Lines 20 Hz apart are two lines, and a column every interval overlaps the one before by half.
WINDOW_S = 0.1
SILENCE_DB = -200.0


class SignalView:
    """Keeps the samples of all channels until the frames that they complete have come, and reduces them.

    `block` and `turning` cost next to nothing; `frame` is called by whoever wants to see something.
    """

    def __init__(self) -> None:
        self._blocks: deque[Block] = deque()
        self._orders: dict[int, Orders] = {}
        self._window: NDArray[np.float64] | None = None

    def block(self, block: Block) -> None:
        """Take samples; those that no frame can need any more are forgotten."""
        # Frames that earlier blocks completed have come: the next one ends after the last of these samples.
        kept_from = _end(self._blocks[-1]) - WINDOW_S * block.sample_rate_hz if self._blocks else 0.0
        while self._blocks and _end(self._blocks[0]) <= kept_from:
            self._blocks.popleft()
        self._blocks.append(block)

    def turning(self, channel: int, orders: Orders) -> None:
        """Take what turned in the interval whose frame comes next."""
        self._orders[channel] = orders

    def frame(self, frame: OdpFrame) -> SignalFrame | None:
        """Reduce the interval of a frame; None if its samples have not been seen."""
        orders = self._orders.get(frame.channel)
        if orders is None or not len(frame):
            return None
        end = frame.first_sample + len(frame)
        if self._window is None:
            self._window = np.hanning(round(WINDOW_S * frame.sample_rate_hz) + 1)[:-1]
        window = self._window
        samples = self._samples(frame.channel, min(frame.first_sample, end - len(window)), end)
        parts = max(1, round(len(frame) / (PART_S * frame.sample_rate_hz)))
        starts = np.arange(parts) * len(frame) // parts
        heard = samples[-len(frame) :]
        spectrum = np.abs(np.fft.rfft(samples[-len(window) :] * window)) * (np.sqrt(2.0) / window.sum())
        lines = (*orders.lines, *orders.other_lines)
        return SignalFrame(
            channel=frame.channel,
            first_sample=frame.first_sample,
            samples=len(frame),
            sample_rate_hz=frame.sample_rate_hz,
            extremes=np.stack([f.reduceat(heard, starts) for f in (np.minimum, np.maximum)], axis=1).astype(np.float32),
            level_db=20.0 * np.log10(np.maximum(spectrum, 10.0 ** (SILENCE_DB / 20.0)))[None].astype(np.float32),
            rotation_hz=orders.rotation_hz,
            orders_hz=tuple(line.frequency_hz for line in sorted(lines, key=lambda line: -line.rms)),
        )

    def _samples(self, channel: int, begin: int, end: int) -> NDArray[np.float64]:
        """Samples from `begin` to before `end`, NaN where there are none."""
        samples = np.full(end - begin, np.nan)
        for block in self._blocks:
            first, last = max(block.first_sample, begin), min(_end(block), end)
            if first < last and not (block.flags and block.flags[channel] & Flag.NON_FINITE):
                samples[first - begin : last - begin] = block.samples[
                    first - block.first_sample : last - block.first_sample, channel
                ]
        return samples


def _end(block: Block) -> int:
    return block.first_sample + len(block.samples)
