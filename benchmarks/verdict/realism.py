"""Are the simulated cuts like real ones? Statistics of both, side by side: a table and a picture.

A score of 0.99 on simulated cuts is worth nothing where real ones look different, so the generator's distributions have
to contain the real values. Whatever is scaled by the gain of a sensor is left out: loudness proves nothing.

Run: python -m benchmarks.verdict.realism [--cuts N] [--out DIR] [--cache DIR]
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import soundfile
import soxr
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table
from scipy.signal import hilbert, welch
from scipy.stats import kurtosis

from benchmarks.verdict.cache import cached_cuts
from benchmarks.verdict.cut import INTERVAL_S, INTERVAL_SAMPLES, RATE_HZ, Cut, Label

Floats = NDArray[np.float64]

# Recordings of real machines; they are read in place where they are at hand, and are no part of the project.
DATA = Path(__file__).parents[3] / "shared" / "data"

# Cuts as they are without somebody's pump, hammer or overdriven amplifier.
PLAIN_FAMILIES = ("ramp", "step", "bar", "forced", "forced_at_resonance", "forced_then_chatter", "low_damped", "stable")

PIECE_S = 0.8  # the accelerometer's burst of chatter lasts no longer
FLOOR_FROM_HZ = 150.0  # the turning excerpts are high-passed there
LINE_HZ, SIDEBANDS_HZ = 12.0, 250.0  # what belongs to a line at this resolution, and how far its sidebands reach


@dataclass(frozen=True)
class Likeness:
    """What is compared; none of it depends on gain.

    Attributes
    ----------
    line_hz : float
        The strongest line above 150 Hz.
    envelope_variation : float
        Standard deviation over mean of the envelope, within 10 % of the line's frequency.
    slow_variation : float
        Same of the envelope below 20 Hz: level, not beating.
    sidebands_db : float
        Power within 250 Hz of the line but not in it, over the line's.
    second_harmonic_db : float
        Power around twice the line's frequency, over the line's.
    line_to_floor_db : float
        Peak of the spectrum over its median.
    flatness_db : float
        Geometric over arithmetic mean of the spectrum.
    kurtosis : float
        Of the waveform above 150 Hz, 0 for Gaussian noise and -1.5 for a sine.
    """

    line_hz: float
    envelope_variation: float
    slow_variation: float
    sidebands_db: float
    second_harmonic_db: float
    line_to_floor_db: float
    flatness_db: float
    kurtosis: float


@dataclass(frozen=True)
class Excerpt:
    """Where in a recording what is heard."""

    name: str
    file: str
    begin_s: float
    end_s: float
    kind: str


EXCERPTS = (
    Excerpt("milling, microphone", "ubc_milling_chatter.flac", 8.5, 17.0, "chatter"),
    Excerpt("milling, accelerometer", "ubc_milling_accelerometer_5k.wav", 4.1, 4.9, "chatter"),
    Excerpt("turning, 770 rpm", "turning_c_770_005_10k.wav", 0.1, 0.9, "chatter"),
    Excerpt("milling, microphone", "ubc_milling_no_chatter.flac", 0.8, 8.8, "stable"),
    Excerpt("milling, accelerometer", "ubc_milling_accelerometer_5k.wav", 3.1, 3.9, "stable"),
    Excerpt("turning, 320 rpm", "turning_s_320_030_10k.wav", 0.1, 0.9, "stable"),
    Excerpt("turning, 320 rpm", "turning_s_320_040_10k.wav", 0.1, 0.9, "stable"),
)


def likeness(piece: Floats, top_hz: float = RATE_HZ / 2) -> Likeness:
    """Measure a piece at 12.8 kHz whose band is filled up to `top_hz`."""
    f, p = welch(piece, RATE_HZ, "hann", nperseg=2048, noverlap=1536)
    usable = (f > FLOOR_FROM_HZ) & (f < 0.92 * top_hz)
    line = float(f[usable][np.argmax(p[usable])])

    def power(around_hz: float, half_hz: float) -> float:
        return float(np.sum(p[np.abs(f - around_hz) <= half_hz]))

    spectrum = np.fft.fft(piece - piece.mean())
    frequency = np.abs(np.fft.fftfreq(piece.size, 1.0 / RATE_HZ))
    narrow = np.fft.ifft(spectrum * (np.abs(frequency - line) < 0.1 * line)).real
    margin = piece.size // 20  # where the periodic continuation shows
    envelope = np.abs(hilbert(narrow))[margin:-margin]
    levels = envelope[: envelope.size // INTERVAL_SAMPLES * INTERVAL_SAMPLES].reshape(-1, INTERVAL_SAMPLES)
    above = np.fft.ifft(spectrum * (frequency > FLOOR_FROM_HZ)).real
    in_line = power(line, LINE_HZ)
    return Likeness(
        line_hz=line,
        envelope_variation=float(envelope.std() / envelope.mean()),
        slow_variation=float(levels.mean(axis=1).std() / envelope.mean()),
        sidebands_db=_db((power(line, SIDEBANDS_HZ) - in_line) / in_line),
        second_harmonic_db=_db(power(2.0 * line, 2.0 * LINE_HZ) / in_line) if 2.0 * line < 0.9 * top_hz else np.nan,
        line_to_floor_db=_db(p[usable].max() / np.median(p[usable])),
        flatness_db=_db(np.exp(np.mean(np.log(p[usable]))) / np.mean(p[usable])),
        kurtosis=float(kurtosis(above)),
    )


def _db(ratio: float) -> float:
    return float(10.0 * np.log10(max(ratio, 1e-12)))


def real_pieces(excerpt: Excerpt) -> Iterator[Likeness]:
    """Measure pieces of a real recording; none where it is not at hand."""
    if not (DATA / excerpt.file).is_file():
        return
    samples, rate = soundfile.read(DATA / excerpt.file, always_2d=True)
    signal = soxr.resample(samples[:, 0], rate, RATE_HZ)
    size = round(PIECE_S * RATE_HZ)
    for first in range(round(excerpt.begin_s * RATE_HZ), round(excerpt.end_s * RATE_HZ) - size + 1, size):
        yield likeness(signal[first : first + size], min(rate, RATE_HZ) / 2)


def simulated_pieces(cut: Cut, kind: str) -> Iterator[Likeness]:
    """Measure pieces of a simulated cut that are of one kind throughout."""
    size = round(PIECE_S / INTERVAL_S)
    truth = cut.truth
    wanted = truth.label == Label.SELF_EXCITED if kind == "chatter" else truth.label < Label.SELF_EXCITED
    if kind == "chatter":
        wanted = wanted & (truth.vibration_rms > 0.5 * truth.vibration_rms.max())  # developed, as in the recordings
    wanted = wanted & (truth.kappa > 0)
    for first in range(0, len(truth) - size + 1, size):
        if wanted[first : first + size].all():
            yield likeness(cut.samples[first * INTERVAL_SAMPLES : (first + size) * INTERVAL_SAMPLES])


def compare(real: dict[Excerpt, list[Likeness]], simulated: list[Likeness], kind: str, console: Console) -> None:
    """Print where the real values lie within the simulated ones."""
    table = Table(title=f"{kind}: real recordings among {len(simulated)} simulated pieces of {PIECE_S:g} s")
    table.add_column("statistic")
    for heading in ("sim. 5 %", "50 %", "95 %"):
        table.add_column(heading, justify="right")
    chosen = [excerpt for excerpt in real if excerpt.kind == kind]
    for excerpt in chosen:
        table.add_column(f"{excerpt.name} (rank)", justify="right")
    for field in fields(Likeness):
        values = np.array([getattr(piece, field.name) for piece in simulated])
        values = values[np.isfinite(values)]
        row = [f"{v:.2f}" for v in np.percentile(values, (5, 50, 95))]
        for excerpt in chosen:
            median = float(np.median([getattr(piece, field.name) for piece in real[excerpt]]))
            row.append("-" if np.isnan(median) else f"{median:.2f} ({100.0 * np.mean(values < median):.0f} %)")
        table.add_row(field.name, *row)
    console.print(table)


def picture(real: dict[Excerpt, list[Likeness]], simulated: dict[str, list[Likeness]], file: Path) -> None:
    """Draw the distribution of each statistic over the simulated pieces with the real pieces as marks."""
    names = [field.name for field in fields(Likeness)]
    figure, axes = plt.subplots(2, len(names) // 2, figsize=(16, 8), constrained_layout=True)
    colours = {"chatter": "tab:red", "stable": "tab:blue"}
    for name, ax in zip(names, axes.flat, strict=True):
        for kind, pieces in simulated.items():
            values = np.array([getattr(piece, name) for piece in pieces])
            ax.hist(
                values[np.isfinite(values)], 40, density=True, alpha=0.3, color=colours[kind], label=f"simulated {kind}"
            )
        top = ax.get_ylim()[1]
        for row, (excerpt, pieces) in enumerate(real.items()):
            values = np.array([getattr(piece, name) for piece in pieces])
            height = np.full(values.size, top * (0.97 - 0.05 * row))
            style = {"color": colours[excerpt.kind], "marker": "os^dv<>"[row], "ls": "", "mec": "k", "ms": 6}
            ax.plot(values, height, label=f"{excerpt.kind}: {excerpt.name}", **style)
        ax.set_title(name)
        ax.set_yticks([])
    axes.flat[0].set_xscale("log")
    axes.flat[0].set_xticks([200, 500, 1000, 2000], ["200", "500", "1000", "2000"])
    axes.flat[0].minorticks_off()
    handles, labels = axes.flat[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5)
    figure.savefig(file, dpi=80)
    plt.close(figure)


def main() -> None:
    """Measure, print, draw."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.verdict.realism", description=__doc__)
    parser.add_argument("--cuts", type=int, default=150, help="cuts of the development split (default 150)")
    parser.add_argument("--out", type=Path, help="directory for the picture")
    parser.add_argument("--cache", type=Path, help="directory to keep generated cuts in")
    chosen = parser.parse_args()
    real = {excerpt: found for excerpt in EXCERPTS if (found := list(real_pieces(excerpt)))}
    if not real:
        raise SystemExit(f"no recordings of real machines in {DATA}: nothing to compare with")
    simulated: dict[str, list[Likeness]] = {"chatter": [], "stable": []}
    made = cached_cuts("development", chosen.cuts, chosen.cache)
    for cut in track(made, total=chosen.cuts, description="cuts", console=Console(stderr=True)):
        if cut.family in PLAIN_FAMILIES:
            for kind, pieces in simulated.items():
                pieces.extend(simulated_pieces(cut, kind))
    for kind, pieces in simulated.items():
        compare(real, pieces, kind, Console(width=150))
    if chosen.out is not None:
        chosen.out.mkdir(parents=True, exist_ok=True)
        picture(real, simulated, chosen.out / "realism.png")


if __name__ == "__main__":
    main()
