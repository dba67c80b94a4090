"""Pictures of the scores, and of the cuts that went worst."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from scipy.signal import spectrogram

from benchmarks.verdict.curves import Detector, curve
from benchmarks.verdict.cut import INTERVAL_S, RATE_HZ, Label
from benchmarks.verdict.scoring import Heard

STATES = ("idle", "stable", "forced", "approaching", "self_excited", "unknown")
LANES = ListedColormap(["#dddddd", "#7fbf7b", "#5b9bd5", "#f4b942", "#d7301f", "#777777"])
# where the truth stands in the same colours
AS_STATE = {Label.OTHER: 1, Label.FORCED: 2, Label.SELF_EXCITED: 4, Label.UNSCORED: 0}
WORST = 8


def draw_curves(name: str, found: list[Detector], heard: list[Heard], file: Path) -> None:
    """Recall against false alarms of the monitor and its peers."""
    figure, ax = plt.subplots(figsize=(9, 6), constrained_layout=True)
    for detector in found:
        _, false, recall = curve(detector, heard)
        width = 2.5 if detector is found[0] else 1.2
        ax.plot(np.maximum(false, 1e-5), recall, label=detector.name, lw=width, drawstyle="steps-post")
    ax.axvline(1e-3, color="k", lw=0.5, ls=":")
    ax.axhline(0.98, color="k", lw=0.5, ls=":")
    ax.set(xscale="log", xlim=(1e-5, 1.0), ylim=(0, 1.02), xlabel="share of false alarms", ylabel="recall")
    ax.set_title(f"Self-excited intervals, {name}")
    figure.legend(loc="outside lower center", ncols=3)
    figure.savefig(file, dpi=90)
    plt.close(figure)


def draw_reliability(name: str, table: list[dict[str, Any]], file: Path) -> None:
    """Share of right verdicts against the confidence they were given with."""
    rows = [row for row in table if row["verdicts"]]
    figure, ax = plt.subplots(figsize=(6, 6), constrained_layout=True)
    ax.plot([0, 1], [0, 1], color="k", lw=0.5)
    sizes = [12.0 + 250.0 * row["verdicts"] / sum(r["verdicts"] for r in rows) for row in rows]
    ax.scatter([row["mean_confidence"] for row in rows], [row["right"] for row in rows], sizes)
    ax.set(xlim=(0, 1.02), ylim=(0, 1.02), xlabel="mean confidence", ylabel="share of right verdicts", title=name)
    figure.savefig(file, dpi=90)
    plt.close(figure)


def draw_worst(name: str, heard: list[Heard], file: Path) -> None:
    """Spectrograms of the cuts with most wrong intervals, of each family at most one, with truth and verdict below."""
    worst: dict[str, Heard] = {}
    for h in sorted(heard, key=_mistakes, reverse=True):
        worst.setdefault(h.cut.family, h)
    chosen = [h for h in worst.values() if _mistakes(h)][:WORST]
    figure, axes = plt.subplots(
        4, 4, figsize=(20, 12), constrained_layout=True, height_ratios=(5, 1, 5, 1), squeeze=False
    )
    for ax in axes.flat:
        ax.set_axis_off()
    for i, h in enumerate(chosen):
        row, column = 2 * (i // 4), i % 4
        _spectrum(axes[row, column], h)
        _lanes(axes[row + 1, column], h)
    figure.suptitle(
        f"{name}: above the truth, below the verdict (green stable, blue forced, yellow approaching, red alarm)"
    )
    figure.savefig(file, dpi=70)
    plt.close(figure)


def _mistakes(h: Heard) -> int:
    label = h.cut.truth.label
    calm = (label == Label.OTHER) | (label == Label.FORCED)
    return int(np.sum(h.alarm & calm) + np.sum(~h.alarm & (label == Label.SELF_EXCITED)))


def _spectrum(ax: Axes, h: Heard) -> None:
    f, t, p = spectrogram(h.cut.samples, RATE_HZ, nperseg=1024, noverlap=512)
    ax.set_axis_on()
    levels = 10.0 * np.log10(np.maximum(p, 1e-20))
    ax.pcolormesh(t, f, levels, vmin=levels.max() - 70.0, vmax=levels.max(), shading="nearest", rasterized=True)
    truth = h.cut.truth
    ax.plot(truth.start_s, truth.frequency_hz, "w:", lw=0.8)
    ax.set_ylim(0, min(6400.0, 4.0 * float(np.median(truth.frequency_hz))))
    tooth_hz = h.cut.teeth * float(np.mean(h.cut.speed_rpm)) / 60.0
    ax.set_title(f"{h.cut.name}\nSNR {h.cut.snr_db:.0f} dB, teeth {tooth_hz:.0f} Hz, {h.cut.sensor}", fontsize=9)


def _lanes(ax: Axes, h: Heard) -> None:
    ax.set_axis_on()
    truth = [AS_STATE[Label(label)] for label in h.cut.truth.label]
    said = [STATES.index(state) for state in h.said.state]
    extent = (0.0, INTERVAL_S * len(truth), 0.0, 2.0)
    ax.imshow([truth, said], aspect="auto", cmap=LANES, vmin=0, vmax=5, extent=extent, interpolation="nearest")
    ax.set_yticks([])
