"""What is said of the recordings of real machines, and why: one picture of all of them."""

from __future__ import annotations

import contextlib
import io
import textwrap
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
import numpy as np
import soundfile

from benchmarks.real import DATA, RECORDINGS
from chatter_monitor.config import load
from chatter_monitor.outlets.look import STATES
from chatter_monitor.records import Verdict
from chatter_monitor.reports.page import hex_colour
from chatter_monitor.service.replay import Replay

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# What is known of them (the data sets' own labels), in the order of `RECORDINGS`.
KNOWN = {
    "turning_chatter": "turning, labelled chatter",
    "turning_stable_30": "turning, labelled stable",
    "turning_stable_40": "turning, labelled stable",
    "milling_chatter": "milling, chatter from 8 to 17.5 s",
    "milling_forced": "milling, forced",
    "milling_burst": "milling by accelerometer, chatter from 4 to 5 s",
}
TOP_HZ, RANGE_DB = 2500.0, 60.0


def draw(folder: Path, out: Path) -> None:
    """Replay all of them, no speed given, and draw spectrogram, verdicts and reasons of each."""
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    figure = Figure(figsize=(13.0, 9.5), layout="constrained")
    for axes, (name, known) in zip(figure.subplots(3, 2).flat, KNOWN.items(), strict=True):
        verdicts = _verdicts(DATA / RECORDINGS[name].file, folder / f"{name}.jsonl")
        _draw(axes, DATA / RECORDINGS[name].file, verdicts)
        why = "\n".join(textwrap.fill(line, 92, subsequent_indent="    ") for line in _told(verdicts))
        axes.set_title(f"{known}\n", loc="left", fontsize="medium", fontweight="bold")
        axes.text(0.0, -0.17, why, transform=axes.transAxes, va="top", fontsize="small")
    patches = [Patch(color=hex_colour(look.colour), label=look.word) for look in STATES.values()]
    figure.legend(handles=patches, ncols=len(patches), loc="outside upper center", frameon=False)
    figure.savefig(out, dpi=80)


def _verdicts(recording: Path, lines: Path) -> list[Verdict]:
    with contextlib.redirect_stdout(io.StringIO()):
        Replay(file=recording, settings=load([]), jsonl=lines).run(as_json=True)
    messages = [msgspec.json.decode(line) for line in lines.read_bytes().splitlines()]
    return [msgspec.convert(message, Verdict) for message in messages if message["type"] == "verdict"]


def _draw(axes: Axes, recording: Path, verdicts: list[Verdict]) -> None:
    """The spectrogram, and above it the verdicts as a lane."""
    samples, rate_hz = soundfile.read(recording)
    points = 1 << int(np.log2(0.05 * rate_hz))
    power, _, _, image = axes.specgram(samples, NFFT=points, Fs=rate_hz, noverlap=3 * points // 4, cmap="cividis")
    loudest = 10.0 * np.log10(power.max())
    image.set_clim(loudest - RANGE_DB, loudest)
    axes.set(ylim=(0.0, TOP_HZ), ylabel="frequency / Hz", xlim=(0.0, len(samples) / rate_hz))
    lane = axes.inset_axes((0.0, 1.02, 1.0, 0.05), sharex=axes)
    for verdict in verdicts:
        span = (verdict.t0, verdict.t1 - verdict.t0)
        lane.broken_barh([span], (0.0, 1.0), color=hex_colour(STATES[verdict.state].colour))
    lane.set_axis_off()


def _told(verdicts: list[Verdict]) -> list[str]:
    """What is said for longest, besides that too little is known, and why; of chatter always, and since when."""
    lines = []
    for state in ("self_excited", Counter(v.state for v in verdicts if v.state != "unknown").most_common(1)[0][0]):
        said = [v for v in verdicts if v.state == state]
        if said and not any(line.startswith(STATES[state].word) for line in lines):
            # of chatter there is most to say when it begins
            told = max(said, key=lambda v: len(v.reasons)) if state == "self_excited" else said[len(said) // 2]
            lines.append(
                f"{STATES[state].word}, first at {said[0].t0:.2f} s: {'; '.join(told.reasons)} ({told.t0:.2f} s)"
            )
    return lines
