"""The plane of the poles: how fast each mode decays, against how fast it vibrates; right of the line it grows."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import rerun as rr

from chatter_monitor.outlets.dashboard.plane import axes, height
from chatter_monitor.outlets.dashboard.stream import Stream
from chatter_monitor.outlets.look import VERMILLION, WHITE, Colour, mode_colour

LEFT_HZ, RIGHT_HZ = -150.0, 50.0
HEIGHT = 140.0
TICKS_HZ = (-150, -100, -50, 0, 50)


@dataclass(frozen=True, slots=True)
class Pole:
    """A mode as it is drawn: its slot, frequency and damping ratio with standard deviations."""

    mode: int
    frequency_hz: float
    damping_ratio: float
    frequency_sd_hz: float
    damping_sd: float

    @property
    def decay_hz(self) -> float:
        """Real part over 2 pi: negative for what decays."""
        return -self.damping_ratio * self.frequency_hz

    @property
    def vibration_hz(self) -> float:
        """Imaginary part over 2 pi."""
        return self.frequency_hz * math.sqrt(max(0.0, 1.0 - self.damping_ratio**2))


class PolePlane:
    """Draws one channel: a dot with its 95 % whiskers for each mode, and where it was in the last seconds.

    Parameters
    ----------
    stream : Stream
        Where to.
    path : str
        Entity that everything lies under.
    """

    def __init__(self, stream: Stream, path: str) -> None:
        self._stream = stream
        self._path = path
        stream.static(
            f"{path}/axes",
            *axes(LEFT_HZ, RIGHT_HZ, HEIGHT, {float(hz): f"{hz} Hz" for hz in TICKS_HZ}),
        )
        stream.static(
            f"{path}/limit",
            rr.LineStrips2D([[[0.0, 0.0], [0.0, HEIGHT]]], colors=[VERMILLION], radii=rr.Radius.ui_points(1.0)),
        )
        stream.static(
            f"{path}/limit/unstable",
            rr.Transform3D(scale=(RIGHT_HZ / 2, HEIGHT / 2, 1.0)),
            rr.Image(np.full((2, 2, 3), (60, 24, 0), np.uint8), draw_order=-100.0),
        )

    def show(self, time_s: float, poles: list[Pole], meant: Pole | None) -> None:
        """Draw the poles of an interval; `meant` is the vibration that the verdict is about, ringed in white."""
        places = [_place(pole.decay_hz, pole.vibration_hz) for pole in poles]
        colours: list[Colour] = [mode_colour(pole.mode) for pole in poles]
        labels = [f"{pole.frequency_hz:.0f} Hz, {100 * pole.damping_ratio:.1f} %" for pole in poles]
        whiskers = [strip for pole in poles for strip in _whiskers(pole)]
        if meant is not None:
            places.append(_place(meant.decay_hz, meant.vibration_hz))
        ringed = [False] * len(poles) + [True] * (meant is not None)
        self._stream.at(
            time_s,
            f"{self._path}/now",
            # the last ones are on top
            rr.Points2D(
                places[::-1],
                colors=[*colours, WHITE][: len(places)][::-1],
                radii=[-8.0 if ring else -5.0 for ring in ringed][::-1],  # negative: pixels
                labels=[*labels, ""][: len(places)][::-1],
                show_labels=True,
            ),
            rr.LineStrips2D(whiskers, colors=[c for c in colours for _ in range(2)], radii=rr.Radius.ui_points(0.8)),
        )
        dots = rr.Points2D(places[: len(poles)], colors=colours, radii=rr.Radius.ui_points(1.2))
        self._stream.at(time_s, f"{self._path}/trail", dots)


def _place(decay_hz: float, vibration_hz: float) -> tuple[float, float]:
    return (min(max(decay_hz, LEFT_HZ), RIGHT_HZ), float(np.clip(height(vibration_hz, HEIGHT), 0.0, HEIGHT)))


def _whiskers(pole: Pole) -> list[list[tuple[float, float]]]:
    """95 % intervals of decay and frequency."""
    decay, vibration = pole.decay_hz, pole.vibration_hz
    along, up = 1.96 * pole.damping_sd * pole.frequency_hz, 1.96 * pole.frequency_sd_hz
    return [
        [_place(decay - along, vibration), _place(decay + along, vibration)],
        [_place(decay, vibration - up), _place(decay, vibration + up)],
    ]
