"""The signal as a person may look at it, against samples that are known."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.client import Subscriber
from chatter_monitor.outlets.signal_view import SignalView
from chatter_monitor.records import Block, Flag, SignalFrame

FS = 12_800.0
WAIT_S = 200.0


def feed(view, samples, sizes):
    """Give a signal to the view in blocks of these sizes, over and over."""
    begin = 0
    while begin < len(samples):
        for size in sizes:
            view.block(Block(begin, samples[begin : begin + size, None], FS))
            begin += size


def test_a_sine_has_its_level_at_its_frequency(make_interval, orders):
    """A sine of rms 0.5 at 1000 Hz peaks in the bin of 1000 Hz at -6.02 dB, and its extremes are its amplitude."""
    t = np.arange(1280) / FS
    view = SignalView()
    feed(view, np.sqrt(0.5) * np.sin(2 * np.pi * 1000.0 * t)[:, None][:, 0], [256])
    view.turning(0, orders)
    signal = view.frame(make_interval(first_sample=640)[0])
    assert np.argmax(signal.level_db[0]) == 100
    assert signal.level_db[0, 100] == pytest.approx(20 * np.log10(0.5), abs=0.01)
    assert signal.extremes.shape == (10, 2)
    np.testing.assert_allclose(signal.extremes, np.sqrt(0.5) * np.tile([-1, 1], (10, 1)), rtol=0.03)


def test_extremes_are_those_of_the_samples_for_any_blocks(make_interval, orders):
    """Whatever the blocks, extremes and spectra are the same, and a spike of one sample stays one."""
    rng = np.random.default_rng(5)
    samples = rng.standard_normal(12_800)
    samples[7_000] = 25.0
    seen = []
    for sizes in ([256], [32_768], [100, 1, 977]):
        view, found = SignalView(), []
        begin = 0
        turns = iter(sizes * len(samples))
        while begin < len(samples):
            size = next(turns)
            view.block(Block(begin, samples[begin : begin + size, None], FS))
            for first in range(-(-begin // 640) * 640 - (640 if begin % 640 else 0), begin + size - 639, 640):
                if first >= 0 and first + 640 <= len(samples):
                    view.turning(0, orders)
                    found.append(view.frame(make_interval(first_sample=first)[0]))
            begin += size
        seen.append(found)
    for found in seen:
        assert [signal.first_sample for signal in found] == list(range(0, 12_800, 640))
        np.testing.assert_array_equal(
            np.concatenate([signal.extremes for signal in found])[:, 1],
            samples.reshape(-1, 64).max(axis=1).astype(np.float32),
        )
        for signal, first in zip(found, seen[0], strict=True):
            np.testing.assert_array_equal(signal.level_db, first.level_db)
    assert np.isnan(seen[0][0].level_db).all()  # the window reaches to before the first sample
    assert np.isfinite(seen[0][1].level_db).all()


def test_what_is_missing_is_not_drawn(make_interval, make_block, orders):
    """Samples that are not numbers, and those of a gap, come out as NaN."""
    view = SignalView()
    view.block(make_block())
    view.block(make_block(first_sample=640, flags=(Flag.NON_FINITE, Flag.NONE)))
    view.block(make_block(first_sample=1280 + 64))
    for channel in (0, 1):
        view.turning(channel, orders)
    first, second = (view.frame(make_interval(first_sample=640, channel=channel)[0]) for channel in (0, 1))
    assert np.isnan(first.extremes).all()
    assert np.isfinite(second.extremes).all()
    after = view.frame(make_interval(first_sample=1280, channel=1)[0])
    assert np.isnan(after.extremes[0]).all()
    assert np.isfinite(after.extremes[1:]).all()


def test_memory_does_not_grow(make_block):
    """After any number of blocks only those that the next frame needs are kept."""
    view = SignalView()
    for k in range(300):
        view.block(make_block(first_sample=256 * k, n=256))
    assert len(view._blocks) == 6  # those with the last 1280 samples, and the new one


def test_a_subscriber_gets_what_the_view_gives(publisher, make_interval, make_block, orders):
    """What travels is bit by bit what was seen, with the orders strongest first, and only to those who asked for it."""
    block = make_block(n=1280)
    with Subscriber(publisher.endpoint, ["signal.0"]) as curious, Subscriber(publisher.endpoint, ["odp.0"]) as other:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.block(block)
        publisher.turning(0, orders)
        received = plain = None
        while received is None or plain is None:  # until both subscriptions have arrived
            publisher.frame(*make_interval(first_sample=640))
            publisher.digest()
            received, plain = received or curious.receive(0.1), plain or other.receive(0.1)
        assert isinstance(received.body, SignalFrame)
        view = SignalView()
        view.block(block)
        view.turning(0, orders)
        expected = view.frame(make_interval(first_sample=640)[0])
        for name in SignalFrame.__dataclass_fields__:
            np.testing.assert_array_equal(getattr(received.body, name), getattr(expected, name))
        assert received.body.orders_hz == (100.0, 90.0)
        assert plain.topic == "odp.0"
        assert not other.malformed


def test_everything_does_not_mean_the_signal(publisher, make_interval, make_block, orders):
    """A subscriber to everything gets the messages of before, also while another one looks at the signal."""
    with Subscriber(publisher.endpoint, ["signal"]) as curious, Subscriber(publisher.endpoint) as everything:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.block(make_block())
        publisher.turning(0, orders)
        looked, topics = None, set()
        while looked is None or not topics:  # until both subscriptions have arrived
            publisher.frame(*make_interval())
            publisher.digest()
            looked = looked or curious.receive(0.1)
            if (received := everything.receive(0.1)) is not None:
                topics.add(received.topic)
        publisher.frame(*make_interval())
        publisher.digest()
        assert looked.topic == "signal.0"
        while (received := everything.receive(0.2)) is not None:
            topics.add(received.topic)
        assert topics == {"odp.0"}
        assert everything.malformed == 0


def test_nothing_is_computed_while_nobody_looks(publisher, make_interval, make_block, orders, monkeypatch):
    """Without a subscriber to the signal the view is not asked to reduce anything."""
    monkeypatch.setattr(publisher._view, "frame", lambda _frame: pytest.fail("computed for nobody"))
    with Subscriber(publisher.endpoint) as other:
        assert publisher.wait_for_subscriber(WAIT_S)
        publisher.block(make_block())
        publisher.turning(0, orders)
        publisher.frame(*make_interval())
        publisher.digest()
        assert other.receive(WAIT_S).topic == "odp.0"
