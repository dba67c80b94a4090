"""Real recordings in other clothes, for rules were made with them in sight.

Each of the six recordings is begun later, played faster and slower (another machine at another speed, as far as one
recording can stand for it), turned over and heard through noise that was not there; nothing is told of the spindle.
Those of chatter need an alarm while it lasts, and no other; those without chatter may have none.

Run: python -m benchmarks.verdict.altered
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import soundfile
import soxr
from numpy.typing import NDArray
from rich.console import Console
from rich.progress import track
from rich.table import Table

from benchmarks.verdict.cut import INTERVAL_S, RATE_HZ
from benchmarks.verdict.monitor import Passage, watch
from benchmarks.verdict.realism import DATA

Floats = NDArray[np.float64]


class Recording(NamedTuple):
    """A recording, from when to when it chatters (s; None for never), and later beginnings that leave enough of it."""

    name: str
    chatter_s: tuple[float, float] | None
    later_s: tuple[float, ...]


RECORDINGS = (
    Recording("ubc_milling_chatter.flac", (7.0, 17.5), (1.0, 2.5)),
    Recording("ubc_milling_accelerometer_5k.wav", (3.8, 5.25), (1.0, 2.5)),  # labelled 4 to 5 s; it dies down
    Recording("ubc_milling_no_chatter.flac", None, (1.0, 2.5)),
    Recording("turning_c_770_005_10k.wav", (0.0, 1.0), (0.05, 0.1, 0.2)),
    Recording("turning_s_320_030_10k.wav", None, (0.05, 0.1, 0.2)),
    Recording("turning_s_320_040_10k.wav", None, (0.05, 0.1, 0.2)),
)
TIMES = (0.5, 0.7, 0.85, 0.9, 0.95, 1.05, 1.1, 1.25)  # as fast
SNR_DB = (20.0, 10.0, 5.0)


class Altered(NamedTuple):
    """One way to play a recording: how many times as fast, from when on (s), through which noise (dB), upside down."""

    times: float = 1.0
    later_s: float = 0.0
    snr_db: float = np.inf
    sign: float = 1.0

    def play(self, samples: Floats, rate_hz: float) -> Floats:
        """Return the samples at the monitor's rate."""
        heard = self.sign * samples[round(self.later_s * rate_hz) :]
        heard = soxr.resample(heard, rate_hz * self.times, RATE_HZ)
        noise = np.random.default_rng(0).standard_normal(len(heard))
        return np.asarray(heard + 10.0 ** (-self.snr_db / 20.0) * np.std(heard) * noise)

    def moment(self, second: float) -> float:
        """When a second of the recording is heard."""
        return (second - self.later_s) / self.times


class Told(NamedTuple):
    """Seconds of alarm and of warning while it chatters, and seconds of alarm while it does not."""

    alarm_s: float
    warning_s: float
    false_s: float


def ways(recording: Recording) -> Iterator[tuple[str, Altered]]:
    """All ways to play a recording, by what they change."""
    yield "as it is", Altered()
    yield "upside down", Altered(sign=-1.0)
    for later_s in recording.later_s:
        yield "begun later", Altered(later_s=later_s)
    for times in TIMES:
        yield "faster or slower", Altered(times)
        yield from (("both", Altered(times, later_s)) for later_s in recording.later_s)
    yield from (("with noise", Altered(snr_db=snr_db)) for snr_db in SNR_DB)


def told(recording: Recording, altered: Altered, samples: Floats, rate_hz: float) -> Told:
    """What the monitor says of a recording that is played so."""
    passage = Passage(altered.play(samples, rate_hz), recording.name, None)
    state = np.array([state for remarks in watch([passage], announce=False) for state in remarks.states])
    begin_s, end_s = INTERVAL_S * np.arange(len(state)), INTERVAL_S * np.arange(1, len(state) + 1)
    chatters = np.zeros(len(state), bool)
    if recording.chatter_s is not None:
        first_s, last_s = map(altered.moment, recording.chatter_s)
        chatters = (end_s > first_s) & (begin_s < last_s)
    alarm, warning = state == "self_excited", state == "approaching"
    parts = alarm & chatters, warning & chatters, alarm & ~chatters
    return Told(*(INTERVAL_S * float(np.sum(each)) for each in parts))


def right(heard: list[Told], recording: Recording) -> str:
    """How many of some ways are told for what they are, and how many more at least by a warning."""
    if recording.chatter_s is None:
        return f"{sum(said.false_s == 0.0 for said in heard)} of {len(heard)}"
    found = sum(said.alarm_s > 0.0 for said in heard)
    warned = sum(said.alarm_s == 0.0 < said.warning_s for said in heard)
    return f"{found}{f' + {warned}' if warned else ''} of {len(heard)}"


def main() -> None:
    """Play all of them and print how often they are told for what they are."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    table = Table(title="ways with an alarm while it chatters (+ a warning instead), or with none where nothing does")
    columns = ("as it is", "upside down", "begun later", "faster or slower", "both", "with noise")
    for name in ("recording", *columns, "ways with a false alarm"):
        table.add_column(name, justify="left" if name == "recording" else "right")
    for recording in track(RECORDINGS, description="recordings"):
        if not (DATA / recording.name).is_file():
            raise SystemExit(f"{recording.name} is not in ../shared/data, and is no part of the project")
        samples, rate_hz = soundfile.read(DATA / recording.name)
        heard = [(kind, told(recording, altered, samples, rate_hz)) for kind, altered in ways(recording)]
        cells = [right([said for kind, said in heard if kind == column], recording) for column in columns]
        table.add_row(recording.name, *cells, f"{sum(said.false_s > 0.0 for _, said in heard)} of {len(heard)}")
    Console(width=160).print(table)


if __name__ == "__main__":
    main()
