"""Results as the tracker and the judge would make them, without either."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import UTC, datetime

import numpy as np
import pytest

from chatter_monitor.outlets.publisher import Clock, Publisher, PublishSettings
from chatter_monitor.records import Advice, Block, Event, Flag, Health, Mode, ModeStatus, Odp, OdpFrame, Verdict
from chatter_monitor.tracking.orders import OrderLine, Orders
from tests.messages import event, health, verdict

FS = 12_800.0
START = datetime(2026, 3, 1, 8, 30, tzinfo=UTC)

Interval = tuple[OdpFrame, Odp]
MakeInterval = Callable[..., Interval]


@pytest.fixture
def make_interval() -> MakeInterval:
    """Intervals with noise in all arrays, and rows that have no values."""
    rng = np.random.default_rng(1)

    def make(first_sample: int = 0, channel: int = 0, n: int = 640, modes: int = 2, lost: int = 0) -> Interval:
        arrays = [rng.standard_normal((n, modes)).astype(np.float32) for _ in range(4)]
        status = rng.choice(np.array(ModeStatus, dtype=np.uint8), (n, modes))
        for array in arrays:
            array[status == ModeStatus.REAL_PAIR] = np.nan
        share = np.full(modes, 0.9 / modes)
        frame = OdpFrame(
            channel,
            first_sample,
            FS,
            *arrays,
            status,
            share,
            signal=rng.standard_normal(n),
            rms=0.25,
            lost=lost,
            flags=Flag.GAP if lost else Flag.NONE,
        )
        seen = [Mode(898.6, 0.0011, (-0.0006, 0.0028), share[0]), Mode(None, None, None, share[0])]
        return frame, Odp(channel=channel, t=(first_sample + n) / FS, modes=seen[:modes])

    return make


@pytest.fixture
def make_block() -> Callable[..., Block]:
    """Blocks of noise on two channels."""
    rng = np.random.default_rng(2)

    def make(first_sample: int = 0, n: int = 640, flags: tuple[Flag, ...] = ()) -> Block:
        return Block(first_sample, rng.standard_normal((n, 2)), FS, flags=flags)

    return make


@pytest.fixture
def orders() -> Orders:
    """A spindle at 1800 rpm whose third order was taken out, and a fan."""
    return Orders(
        0,
        30.0,
        0.01,
        "refined",
        0.2,
        (OrderLine(3, 90.0, 0.1),),
        other_hz=50.0,
        other_lines=(OrderLine(2, 100.0, 0.3),),
    )


@pytest.fixture
def messages() -> list[Verdict | Event | Health]:
    """Messages of each kind, with every field set and with every default."""
    return [
        Verdict(
            channel=0,
            t0=1.2,
            t1=1.25,
            sample0=15360,
            sample1=16000,
            state="self_excited",
            frequency_hz=898.6,
            damping_ratio=-0.0011,
            damping_ratio_ci95=(-0.0016, -0.0006),
            order=7.0,
            confidence=0.98,
            chatter_probability=0.98,
            margin_percent=-3.0,
            reasons=["damping is negative"],
            flags=["clipped"],
        ),
        verdict(24, "unknown", channel=1),
        Event(
            id="a1",
            channel=0,
            kind="chatter",
            onset_s=1.2,
            end_s=3.5,
            peak_frequency_hz=898.6,
            min_damping_ratio=-0.004,
            advice=[Advice(spindle_rpm=1797.2, lobe=5)],
            recording="a1.flac",
        ),
        event(id="a2"),
        Health(
            t=2.0,
            state="hearing",
            samples_in=25600,
            lost=12,
            overflows=1,
            clipped=3,
            non_finite=0,
            publications_dropped=2,
            ring_fill=0.1,
            latency_ms_p50=4.5,
            latency_ms_p99=12.5,
            reasons=["samples were lost"],
        ),
        health(t=3.0, state="finished", samples_in=38400),
    ]


@pytest.fixture
def clock() -> Clock:
    """The first sample was taken at `START`."""
    return Clock(FS, START)


@pytest.fixture
def publisher(clock: Clock) -> Iterator[Publisher]:
    """A publisher on a free port."""
    with Publisher(PublishSettings(bind="tcp://127.0.0.1:0"), clock=clock, machine="lathe-3") as publisher:
        yield publisher
