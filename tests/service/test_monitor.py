"""Losses on the way from a source to the messages."""

from __future__ import annotations

import time

import msgspec
import numpy as np
import pytest

from chatter_monitor.acquisition.source import Condition, Source
from chatter_monitor.config import Settings
from chatter_monitor.outlets.control import SetSpindle
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Block, Flag, Health, Verdict
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.verdict.judge import Judge
from tests.signals import RATE_HZ, vibration

SIGNAL = np.stack([vibration(25_600, [(400, 0.03)], seed) for seed in (1, 2)], axis=1)
LOST = range(10_000, 11_000)


class Lossy(Source):
    """Two channels that lose the samples `LOST`; clipping on channel 1 afterwards."""

    sample_rate_hz, channels, length = RATE_HZ, 2, None
    clipped_samples, non_finite_samples = 7, 0

    def __init__(self, block_samples):
        self._block_samples = block_samples

    def blocks(self):
        end = 0
        stretches = [(0, LOST.start, ()), (LOST.stop, 20_000, ()), (20_000, 25_600, (Flag.NONE, Flag.CLIPPED))]
        for begin, stop, flags in stretches:
            for first in range(begin, stop, self._block_samples):
                samples = SIGNAL[first : min(stop, first + self._block_samples)]
                yield Block(first, samples, RATE_HZ, lost=first - end, flags=flags)
                end = first + len(samples)

    def close(self):
        pass


class Kept(Outlet):
    """Keeps the messages."""

    def __init__(self):
        self.messages = []

    def frame(self, frame, odp):  # noqa: ARG002
        self.messages.append(odp)

    def message(self, message):
        self.messages.append(message)

    def close(self):
        pass


def monitored(block_samples):
    source, kept = Lossy(block_samples), Kept()
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "lossy", "clock": time.perf_counter}
    done = list(Monitor(Settings(), source, [kept], **about).run())
    assert done[-1] == len(SIGNAL)
    return [msgspec.to_builtins(message) for message in kept.messages]


@pytest.fixture(scope="module")
def messages():
    return monitored(4096)


def verdicts(messages, channel):
    return [message for message in messages if message["type"] == "verdict" and message["channel"] == channel]


def test_loss_is_unknown_where_it_lies(messages):
    """Exactly the intervals that a gap touches are unknown under its flag, in every channel; their samples count."""
    for channel in (0, 1):
        of_channel = verdicts(messages, channel)
        assert [(v["sample0"], v["sample1"]) for v in of_channel] == [(i, i + 640) for i in range(0, 25_600, 640)]
        assert [i for i, v in enumerate(of_channel) if "gap" in v["flags"]] == [15, 16, 17]
        assert [i for i, v in enumerate(of_channel) if v["state"] == "unknown"] == [0, 15, 16, 17]


def test_flags_belong_to_their_channel(messages):
    """Clipping of one channel does not stand on the other."""
    clipped = [[i for i, v in enumerate(verdicts(messages, c)) if "clipped" in v["flags"]] for c in (0, 1)]
    assert clipped == [[], list(range(31, 40))]


@pytest.mark.parametrize("block_samples", [100, 640, 25_600])
def test_blocks_of_any_size_give_the_same_messages(messages, block_samples):
    """Whatever the blocks, ODPs and verdicts are the same in the same order for each channel."""
    others = monitored(block_samples)
    for channel in (0, 1):
        of_channel, expected = (
            [m for m in each if m["type"] != "health" and m.get("channel") == channel] for each in (others, messages)
        )
        assert of_channel == expected


def test_outlets_digest_when_all_verdicts_are_out():
    """What an outlet leaves for later is done after the last channel's verdict and before the next block."""

    class Digesting(Kept):
        def block(self, block):
            self.messages.append(f"block {block.first_sample}")

        def digest(self):
            self.messages.append("digested")

    source, kept = Lossy(640), Digesting()
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "lossy", "clock": time.perf_counter}
    list(Monitor(Settings(), source, [kept], **about).run())
    heard = [getattr(message, "channel", message) for message in kept.messages if not isinstance(message, Health)]
    assert heard[:6] == ["block 0", 0, 0, 1, 1, "digested"]
    assert heard[6] == "block 640"
    assert heard.count("digested") == sum(str(each).startswith("block") for each in heard) + 1  # and at the end


def test_health_counts_what_was_lost(messages):
    """Health, once a second and at the end, tells samples in, samples lost and clipped, and the loss in words."""
    health = [message for message in messages if message["type"] == "health"]
    assert [(h["t"], h["state"]) for h in health] == [(1.0, "hearing"), (2.0, "hearing"), (2.0, "finished")]
    assert (health[-1]["samples_in"], health[-1]["lost"], health[-1]["clipped"]) == (24_600, 1000, 7)
    assert health[-1]["reasons"] == ["1000 samples lost"]


def test_settings_reach_the_judges():
    """A stable cut is an alarm where the thresholds say so."""
    settings = Settings()
    at_once = msgspec.structs.replace(settings.verdict, alarm_probability=1e-12, calm_probability=1e-12)
    eager = msgspec.structs.replace(settings, verdict=at_once)
    source, kept = Lossy(4096), Kept()
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "x", "clock": time.perf_counter}
    list(Monitor(eager, source, [kept], **about).run())
    found = verdicts([msgspec.to_builtins(message) for message in kept.messages], 0)
    assert sum(v["state"] == "self_excited" for v in found) > 20


def test_another_job_is_told_to_the_judges(monkeypatch):
    """As a speed or a cutter that is not the one from before; a control may repeat it, not quite to the last digit."""
    began = []
    monkeypatch.setattr(Judge, "begin_job", lambda judge: began.append(judge))
    speeds = [(1700.0, 4), (1701.0, 4), (1700.0, 3), (1900.0, 3), (None, 3)]
    waiting = [[SetSpindle(rpm=rpm, teeth=teeth)] for rpm, teeth in speeds]
    source = Lossy(4096)
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "x", "clock": time.perf_counter}
    list(Monitor(Settings(), source, [], commands=lambda: waiting.pop(0) if waiting else [], **about).run())
    assert not waiting
    assert len(began) == 4 * source.channels
    assert len(set(began)) == source.channels


class Moody(Source):
    """Hears for a second, is deaf for 2.3 s, and hears again for 70 s."""

    sample_rate_hz, channels, length = RATE_HZ, 1, None
    clipped_samples, non_finite_samples = 0, 0

    def __init__(self, clock):
        self._clock = clock
        self._hearing = True

    def condition(self):
        return Condition(hearing=self._hearing, problems=() if self._hearing else ("the plug is out",), overflows=3)

    def blocks(self):
        end = 0
        for hearing, intervals in ((True, 20), (False, 46), (True, 1400)):
            for _ in range(intervals):
                self._hearing = hearing
                samples = SIGNAL[:640, :1] if hearing else np.empty((0, 1))
                lost = 0 if hearing else 640
                self._clock["s"] += 1.0
                yield Block(end + lost, samples, RATE_HZ, lost, arrived_s=self._clock["s"] - 0.004 if hearing else None)
                end += 640

    def close(self):
        pass


@pytest.fixture(scope="module")
def moods():
    clock, kept = {"s": 0.0}, Kept()
    source = Moody(clock)
    about = {"counts": source, "source_rate_hz": RATE_HZ, "session": "moody", "clock": lambda: clock["s"]}
    list(Monitor(Settings(), source, [kept], **about).run())
    return kept.messages


def test_deafness_is_told_at_once_and_every_second(moods):
    """Health comes every second of time, hearing or not, and when one becomes the other, with the source's reason."""
    healths = [message for message in moods if isinstance(message, Health)]
    assert [(round(h.t, 2), h.state) for h in healths[:7]] == [
        (1.0, "hearing"),
        (1.05, "not_hearing"),
        (2.0, "not_hearing"),
        (3.0, "not_hearing"),
        (3.35, "hearing"),
        (4.0, "hearing"),
        (5.0, "hearing"),
    ]
    assert healths[2].reasons == ["the plug is out", "12800 samples lost"]
    assert healths[2].overflows == 3


def test_unknown_has_the_sources_reason(moods):
    """While nothing is heard verdicts go on, unknown for the reason that the source gives."""
    deaf = [m for m in moods if isinstance(m, Verdict) and m.t0 >= 1.0 and m.t1 <= 3.3]
    assert len(deaf) == 46
    assert all(verdict.state == "unknown" and "the plug is out" in verdict.reasons for verdict in deaf)


def test_a_loss_is_news_for_a_minute(moods):
    """The count of lost samples stays, the words do not."""
    healths = [message for message in moods if isinstance(message, Health)]
    lost = 46 * 640
    assert {h.lost for h in healths if h.t > 3.3} == {lost}
    assert {h.t < 63.3 for h in healths if h.reasons == [f"{lost} samples lost"]} == {True}
    assert {h.t > 63.3 for h in healths if h.t > 3.3 and not h.reasons} == {True}


def test_latency_counts_from_the_callback(moods):
    """Latency is the time from the arrival of a block's last sample at the callback; what was not heard has none."""
    healths = [message for message in moods if isinstance(message, Health)]
    assert healths[0].latency_ms_p50 == pytest.approx(4.0)
    assert healths[2].latency_ms_p99 is None
