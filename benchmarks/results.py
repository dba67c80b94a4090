"""What `python -m benchmarks` measures, and the JSON file that it goes into."""

from __future__ import annotations

import os
from datetime import UTC, datetime
from pathlib import Path

import msgspec
import numpy as np

FILE = Path(__file__).resolve().parents[1] / "docs" / "performance.json"


class Cost(msgspec.Struct, frozen=True):
    """Processor time of a part of the program, and of yardsticks that were timed in turns with it.

    Attributes
    ----------
    part : str
        What was measured.
    ns : float
        Nanoseconds per sample, the least of all rounds.
    yardsticks_ns : dict
        The same of each yardstick, by its name.
    """

    part: str
    ns: float
    yardsticks_ns: dict[str, float]


class Growth(msgspec.Struct, frozen=True):
    """How the cost grows with something.

    Attributes
    ----------
    cost : str
        What costs.
    along : str
        What grows.
    at : list of float
        Its values.
    seconds : list of float
        Processor seconds at each, the least of all rounds.
    resident_mb : list of float or None
        Memory that lies in the machine's at each, without the signal that is fed.
    """

    cost: str
    along: str
    at: list[float]
    seconds: list[float]
    resident_mb: list[float] | None = None

    @property
    def exponent(self) -> float:
        """Slope of the straight line through the logarithms: 1 is linear."""
        return float(np.polyfit(np.log(self.at), np.log(self.seconds), 1)[0])


class Results(msgspec.Struct, frozen=True):
    """One run of the suite.

    Attributes
    ----------
    date : str
        Day on which it ended.
    processor : str
        What it ran on.
    cores : int
        How many of them.
    load : tuple of float
        Processes that wanted a core, this one among them, in the minute before the run began and before it ended.
    rounds : int
        How often each was measured.
    """

    date: str
    processor: str
    cores: int
    load: tuple[float, float]
    rounds: int
    costs: list[Cost]
    growths: list[Growth]


def load_now() -> float:
    """Mean number of processes that wanted a core in the last minute."""
    return os.getloadavg()[0]


def results(costs: list[Cost], growths: list[Growth], load_before: float, rounds: int) -> Results:
    """Results of a run that ends now, on this machine."""
    about = Path("/proc/cpuinfo").read_text()
    processor = about.split("model name\t: ")[1].splitlines()[0] if "model name\t: " in about else "unknown"
    return Results(
        date=datetime.now(UTC).date().isoformat(),
        processor=processor,
        cores=os.cpu_count() or 1,
        load=(round(load_before, 1), round(load_now(), 1)),
        rounds=rounds,
        costs=costs,
        growths=growths,
    )


def save(found: Results, path: Path) -> None:
    """Write the file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(msgspec.json.format(msgspec.json.encode(found), indent=1) + b"\n")


def read(path: Path = FILE) -> Results:
    """Read the file."""
    return msgspec.json.decode(path.read_bytes(), type=Results)
