"""Make the pictures of the dashboard and of the reports: ``python -m docs.pictures [--out DIRECTORY]``."""

from __future__ import annotations

import base64
import contextlib
import io
import re
import tempfile
from pathlib import Path
from typing import Any

import click

from benchmarks.real import DATA
from benchmarks.real import diagnosed as diagnosed_real
from chatter_monitor.config import load
from chatter_monitor.outlets.dashboard.place import Place
from chatter_monitor.outlets.event_store import EventStore
from chatter_monitor.service.diagnosing import diagnose_file
from chatter_monitor.service.modelling import simulate_to_file
from chatter_monitor.service.replay import Replay
from chatter_monitor.service.reporting import report_event
from chatter_monitor.service.showing import show_diagnosis, show_recording
from docs.pictures import recordings
from docs.pictures.browser import photograph
from docs.pictures.viewer import viewer

HERE = Path(__file__).parent
REPLAY_DATA = HERE.parents[1] / "replay_data"

# Name of the picture, recording, what turns, and the time that is shown.
REPLAYS: tuple[tuple[str, str, dict[str, Any], float], ...] = (
    ("dashboard_chatter", "bar_turning.flac", {"speed_rpm": 1685.0, "teeth": 1}, 14.5),
    ("dashboard_onset", "bar_turning.flac", {"speed_rpm": 1685.0, "teeth": 1}, 7.2),
    ("dashboard_forced", "forced_milling.flac", {"speed_rpm": 1656.0, "teeth": 6}, 9.0),
)
# On a machine that is busy the viewer's notes on starting stay for longer.
UNHURRIED_S = 20.0
# The worked example of docs/tutorial.md.
MACHINE = """[sensor]
quantity = "velocity"
noise_rms = 40.0
[[mode]]
frequency_hz = 412.0
damping_ratio = 0.02
"""
JOINT = """[[term]]
name = "cubic_stiffness"
coefficient = 0.02
"""
# That of docs/diagnose.md.
ROUND = """[sensor]
quantity = "acceleration"
noise_rms = 2e5
[[mode]]
frequency_hz = 286.0
damping_ratio = 0.015
"""
PLAY = """[[term]]
name = "clearance"
coefficient = 0.06
gap = 1.0
"""


def quiet(_line: str) -> None:
    """Say nothing: a file is saved."""


@click.command()
@click.option("--out", type=click.Path(path_type=Path), default=HERE, help="Directory to write into.")
def main(out: Path) -> None:
    """Make all of them."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        for name, recording, spindle, time_s in REPLAYS:
            saved = Path(folder) / f"{name}.rrd"
            show_recording(REPLAY_DATA / recording, load([], {"spindle": spindle}), Place(save=saved), quiet)
            with viewer(saved, UNHURRIED_S) as shown:
                shown.go(time_s)
                shown.save(out / f"{name}.png")
        saved = diagnosed(Path(folder))
        with viewer(saved, UNHURRIED_S) as shown:
            shown.save(out / "dashboard_diagnosis.png")
        photograph(Path(folder) / "diagnosis" / "report.html", out / "report_diagnosis.png", width=900, height=960)
        real_recordings(Path(folder) / "real", out)
        play_in_a_joint(Path(folder) / "play", out)
        photograph(reported(Path(folder)), out / "report_event.png", width=900, height=1300)


def real_recordings(folder: Path, out: Path) -> None:
    """Draw the verdicts on the real recordings, and take the maps out of the report on the turning that chatters."""
    if DATA.is_dir():
        folder.mkdir(parents=True, exist_ok=True)
        recordings.draw(folder, out / "real_verdicts.png")
        diagnosed_real("turning_chatter", folder)
        maps, *_ = embedded(folder / "report.html")
        (out / "real_turning.png").write_bytes(maps)


def play_in_a_joint(folder: Path, out: Path) -> None:
    """Take the pictures out of the report of the worked example of docs/diagnose.md."""
    folder.mkdir()
    (folder / "machine.toml").write_text(ROUND + PLAY)
    (folder / "model.toml").write_text(ROUND)
    simulate_to_file(folder / "machine.toml", 20.0, 11, folder / "cut.wav", 12_800)
    diagnose_file(folder / "cut.wav", folder / "model.toml", folder / "diagnosis")
    maps, comparison, energy = embedded(folder / "diagnosis" / "report.html")
    (out / "diagnose_differ.png").write_bytes(maps)
    (out / "diagnose_same.png").write_bytes(comparison)
    (out / "diagnose_energy.png").write_bytes(energy)


def embedded(report: Path) -> list[bytes]:
    """Pictures of a report."""
    found = re.findall(r"data:image/png;base64,([^\"]+)", report.read_text(encoding="utf-8"))
    return [base64.b64decode(picture) for picture in found]


def diagnosed(folder: Path) -> Path:
    """Diagnose a simulated recording of a machine with a joint that hardens against a model without it."""
    (folder / "machine.toml").write_text(MACHINE + JOINT)
    (folder / "model.toml").write_text(MACHINE)
    simulate_to_file(folder / "machine.toml", 20.0, 7, folder / "cut.wav", 12_800)
    diagnose_file(folder / "cut.wav", folder / "model.toml", folder / "diagnosis")
    saved = folder / "diagnosis.rrd"
    show_diagnosis(folder / "diagnosis", Place(save=saved), quiet)
    return saved


def reported(folder: Path) -> Path:
    """Report of the event of docs/tutorial.md."""
    settings = load([], {"spindle": {"speed_rpm": 1685.0, "teeth": 1}})
    with contextlib.redirect_stdout(io.StringIO()):
        Replay(file=REPLAY_DATA / "bar_turning.flac", settings=settings, record=folder / "events").run(as_json=True)
    [entry] = EventStore(folder / "events").entries()
    report_event(entry, folder / "event.html")
    return folder / "event.html"


if __name__ == "__main__":
    main()
