"""Messages of the public contract, of which a test says only what matters to it."""

from __future__ import annotations

from chatter_monitor.records import Event, Health, State, Verdict

RATE_HZ = 12_800
INTERVAL = 640


def verdict(number: int = 0, state: State = "stable", channel: int = 0, **about) -> Verdict:
    """Verdict on the interval of that number."""
    first, end = number * INTERVAL, (number + 1) * INTERVAL
    return Verdict(
        channel=channel, t0=first / RATE_HZ, t1=end / RATE_HZ, sample0=first, sample1=end, state=state, **about
    )


def event(**about) -> Event:
    """A second of chatter."""
    whole = {
        "id": "cut-0-0001",
        "channel": 0,
        "kind": "chatter",
        "onset_s": 1.0,
        "end_s": 2.0,
        "peak_frequency_hz": 900.0,
        "min_damping_ratio": -0.001,
    }
    return Event(**whole | about)


def health(**about) -> Health:
    """A monitor that hears, and nothing is wrong."""
    counts = ("samples_in", "lost", "overflows", "clipped", "non_finite", "publications_dropped")
    whole = dict.fromkeys(counts, 0) | {
        "t": 0.0,
        "state": "hearing",
        "ring_fill": 0.0,
        "latency_ms_p50": None,
        "latency_ms_p99": None,
    }
    return Health(**whole | about)
