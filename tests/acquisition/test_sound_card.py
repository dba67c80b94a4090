"""A sound card whose device and clock are in the test's hands: what is heard, what is lost, and what is said."""

from __future__ import annotations

import os
import signal
import threading
import time
from contextlib import contextmanager

import numpy as np
import pytest

from chatter_monitor.acquisition.capture import Patience
from chatter_monitor.acquisition.index_clock import IndexClock
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.acquisition.settings import InputSettings
from chatter_monitor.acquisition.sound_card import SoundCard
from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.records import Flag
from tests.fake_card import Clock, FakeDevices, eventually

RATE_HZ = 12_800.0
QUICK = Patience(tick_s=0.001, reopen_s=(0.001,))


class Listening:
    """A card, and a thread that takes its blocks; the index is checked to be without a hole or an overlap."""

    def __init__(self, devices, settings):
        self.clock = Clock()
        self.devices = devices
        index_clock = IndexClock(RATE_HZ, steady=self.clock, utc=self.clock)
        self.card = SoundCard(
            settings, RATE_HZ, opener=devices, index_clock=index_clock, clock=self.clock, patience=QUICK
        )
        self.blocks = []
        self.error = None
        self.thread = threading.Thread(target=self._listen)

    def _listen(self):
        end = 0
        try:
            for block in self.card.blocks():
                assert block.first_sample == end + block.lost
                assert block.lost >= 0
                assert block.samples.shape[1] == self.card.channels
                end = block.first_sample + len(block.samples)
                self.blocks.append(block)
        except BaseException as error:
            self.error = error

    @property
    def lost(self):
        return sum(block.lost for block in self.blocks)

    @property
    def heard(self):
        """Samples so far, shape (n, channels)."""
        return np.concatenate([block.samples for block in self.blocks])

    @property
    def end(self):
        return self.blocks[-1].first_sample + len(self.blocks[-1].samples) if self.blocks else 0

    def flags(self, channel=0):
        """A flag for each sample heard."""
        return np.concatenate([np.full(len(b.samples), b.channel_flags(channel) & ~Flag.GAP) for b in self.blocks])

    def has_heard(self, samples):
        eventually(lambda: self.error is not None or sum(len(block.samples) for block in list(self.blocks)) >= samples)
        assert self.error is None


@contextmanager
def listening(devices, settings=None):
    listener = Listening(devices, settings or InputSettings())
    listener.thread.start()
    try:
        yield listener
    finally:
        listener.card.close()
        listener.thread.join(20.0)
    assert not listener.thread.is_alive()
    if listener.error is not None:
        raise listener.error


def noise(samples, seed=1):
    return 0.1 * np.random.default_rng(seed).standard_normal(samples).astype(np.float32)


def test_every_sample_is_heard_in_its_order():
    """What the device delivers comes out bit by bit, the wanted channels in the wanted order, in the sensor's units."""
    samples = noise(3 * 5000).reshape(-1, 3)
    with listening(FakeDevices(channels=3), InputSettings(channels=(2, 0), full_scale_per_unit=0.5)) as listener:
        device = listener.devices.opened()
        for piece in np.array_split(samples, 37):
            device.deliver(piece)
        listener.has_heard(len(samples))
        assert listener.card.condition().hearing
    assert np.array_equal(listener.heard, samples[:, [2, 0]].astype(float) / 0.5)
    assert device.closed.is_set()


def test_another_rate_is_converted_like_a_recording():
    """A device at 48 kHz gives what a recording at 48 kHz gives, up to where the filter knows what comes next."""
    samples = noise(48_000)
    more = noise(4800, seed=2)  # that a recording has, and the device does not deliver any more
    with listening(FakeDevices(48_000.0)) as listener:
        device = listener.devices.opened()
        for piece in np.array_split(samples, 50):
            device.deliver(piece)
        listener.has_heard(12_700)
        assert {block.arrived_s for block in listener.blocks} == {listener.clock.now_s}
        device.end()
        eventually(lambda: not listener.card.condition().hearing)
    recording = Synthetic.from_array(np.concatenate([samples, more]).astype(np.float64), 48_000.0)
    expected = np.concatenate([block.samples for block in Resampled(recording, RATE_HZ).blocks()])
    assert np.array_equal(listener.heard, expected[: len(listener.heard)])


def test_a_device_without_a_word_is_given_up_and_opened_again():
    """After 0.5 s without a delivery a device is frozen: the loss goes on by the clock until it is opened again."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(noise(1280))
        listener.has_heard(1280)
        begin = listener.end
        device.hangs.set()
        listener.clock.now_s += 0.4
        assert not device.closed.wait(0.05)
        assert listener.card.condition().hearing
        listener.clock.now_s += 0.2
        eventually(lambda: not listener.card.condition().hearing)
        eventually(lambda: listener.end > begin)
        assert any("frozen" in problem for problem in listener.card.condition().problems)
        listener.clock.now_s += 4.4
        eventually(lambda: listener.end >= begin + 4.9 * RATE_HZ)  # while closing hangs
        device.hangs.clear()
        assert device.closed.wait(20.0)
        back = listener.devices.opened()
        back.deliver(noise(10, seed=2))
        listener.has_heard(1290)
        assert listener.card.condition().hearing
        assert listener.card.condition().problems == ()
    assert listener.end - begin == pytest.approx(5.0 * RATE_HZ, abs=1)
    assert listener.lost == listener.end - 1290
    assert np.array_equal(listener.heard[1280:, 0], noise(10, seed=2).astype(float))


def test_a_device_that_goes_away_is_missed_at_once():
    """A device that says that it has ended is looked for again, and meanwhile the reason is why there is none."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(noise(128))
        listener.has_heard(128)
        listener.devices.absent = "it is not plugged in"
        device.end()
        eventually(lambda: any("not plugged in" in problem for problem in listener.card.condition().problems))
        listener.clock.now_s += 2.0
        eventually(lambda: listener.lost >= 1.9 * RATE_HZ)
        listener.devices.absent = None
        listener.devices.opened().deliver(noise(128))
        listener.has_heard(256)
        assert listener.card.condition().hearing


def test_what_came_before_the_end_is_not_lost():
    """Samples that wait in the ring when a device goes away are heard."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(noise(5000))
        device.end()
        listener.has_heard(5000)
    assert np.array_equal(listener.heard[:, 0], noise(5000).astype(float))


def test_a_device_at_another_rate_takes_its_place():
    """A device that comes back with another rate is heard at the tracker's, and the index goes on."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(noise(1280))
        listener.has_heard(1280)
        listener.devices.rate_hz = 48_000.0
        listener.clock.now_s += 1.0
        device.end()
        other = listener.devices.opened()
        other.deliver(noise(48_000))
        listener.has_heard(1280 + 12_700)
        assert listener.card.device == "'fake' at 48 kHz"


def test_an_overflow_is_flagged_counted_and_placed_by_the_clock():
    """The device does not say how much an overflow took, the clock does; the samples behind it are flagged."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(noise(1280))
        listener.has_heard(1280)
        end = listener.end
        listener.clock.now_s += 0.3  # in which 3840 samples should have come
        device.deliver(noise(1280, seed=2), overflow=True)
        listener.has_heard(2560)
        device.deliver(noise(1280, seed=3))
        listener.has_heard(3840)
        assert listener.card.condition().overflows == 1
    (after,) = [block for block in listener.blocks if block.first_sample > end and block.lost]
    assert after.lost == pytest.approx(0.3 * RATE_HZ - 1280, abs=1)
    assert list(listener.flags()) == [Flag.NONE] * 1280 + [Flag.OVERFLOW] * 1280 + [Flag.NONE] * 1280


def test_a_dead_channel_is_flagged_and_told_and_may_come_back():
    """A channel that has not changed for a second is dead, alone; when all are, the monitor does not hear."""
    samples = np.stack([noise(25_600), np.full(25_600, 0.25, np.float32)], axis=1)
    with listening(FakeDevices(channels=2), InputSettings(channels=(0, 1))) as listener:
        device = listener.devices.opened()
        for piece in np.array_split(samples, 100):
            device.deliver(piece)
        listener.has_heard(25_600)
        condition = listener.card.condition()
        assert condition.hearing
        assert [problem[:17] for problem in condition.problems] == ["channel 1 is dead"]
        device.deliver(np.zeros((12_801, 2)))
        listener.has_heard(25_600 + 12_801)
        eventually(lambda: not listener.card.condition().hearing)
        device.deliver(np.stack([noise(10), noise(10)], axis=1))
        eventually(lambda: listener.card.condition().hearing)
        assert listener.card.condition().problems == ()
    assert not (listener.flags(0)[:25_600] & Flag.DEAD_CHANNEL).any()
    dead = listener.flags(1) == Flag.DEAD_CHANNEL
    assert np.array_equal(np.flatnonzero(dead[:25_600]), np.arange(12_800, 25_600))


def test_clipping_is_told_while_it_is_news():
    """Samples at full scale are flagged and counted, and for ten seconds the remedy is told."""
    samples = noise(1280)
    samples[100:110] = 1.0
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(samples)
        listener.has_heard(1280)
        assert listener.card.clipped_samples == 10
        assert "turn the gain down" in listener.card.condition().problems[0]
        listener.clock.now_s += 0.4
        device.deliver(noise(1280))
        listener.has_heard(2560)
        for _ in range(25):
            listener.clock.now_s += 0.4
            device.deliver(noise(5120))
        eventually(lambda: not listener.card.condition().problems)
        device.end()
        listener.devices.opened().deliver(samples)
        eventually(lambda: listener.card.clipped_samples == 20)
    assert (listener.flags() & Flag.CLIPPED).any()


def test_a_wrong_rate_is_told():
    """A card that runs 2.5 % slow is told with what that does to frequencies; one that is 0.16 % off is fine."""
    for true_hz, told in ((0.975 * RATE_HZ, "read +2.6 %"), (0.9984375 * RATE_HZ, None)):
        with listening(FakeDevices()) as listener:
            device = listener.devices.opened()
            for second in range(1, 350):
                listener.clock.now_s += 0.1
                device.deliver(noise(round(0.1 * true_hz)))
                listener.has_heard(second * round(0.1 * true_hz))
            problems = listener.card.condition().problems
            assert [told in problem for problem in problems] == [True] if told else problems == ()


def test_a_worker_that_falls_behind_loses_the_exact_number():
    """What finds no room in the ring is lost at its exact place."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        device.deliver(noise(60_000))  # more than the ring holds
        listener.has_heard(51_200)
        eventually(lambda: listener.card.condition().ring_fill == 0.0)
        device.deliver(noise(100, seed=3))
        listener.has_heard(51_300)
    assert sum(block.lost for block in listener.blocks if block.first_sample > 51_200) == 60_000 - 51_200


def test_a_card_whose_thread_dies_takes_the_worker_along():
    """An error that nobody foresaw ends the blocks, instead of silence for ever."""

    class Broken(FakeDevices):
        def choose(self):
            raise ZeroDivisionError("somewhere")

    with pytest.raises(ZeroDivisionError), listening(Broken()) as listener:
        listener.thread.join(20.0)


def test_a_device_that_hangs_does_not_hold_up_the_end():
    """Closing waits for a frozen device for half a second, no longer."""
    devices = FakeDevices()
    with listening(devices) as listener:
        device = devices.opened()
        device.deliver(noise(128))
        listener.has_heard(128)
        device.hangs.set()
    device.hangs.clear()
    assert not listener.thread.is_alive()


def test_absent_devices_are_looked_for_with_growing_patience():
    """Attempts follow after the given waits, the last one again and again."""
    devices = FakeDevices()
    devices.absent = "nothing there"
    clock = Clock()
    waits = []

    index_clock = IndexClock(RATE_HZ, clock, clock)
    card = SoundCard(InputSettings(), RATE_HZ, opener=devices, index_clock=index_clock, clock=clock, sleep=waits.append)
    thread = threading.Thread(target=lambda: list(card.blocks()))
    thread.start()
    eventually(lambda: len(waits) >= 6)
    card.close()
    thread.join(20.0)
    assert waits[:6] == [0.1, 0.2, 0.5, 1.0, 1.0, 1.0]


@pytest.mark.timeout(30)
def test_a_signal_whose_handler_is_slow_stops_a_card_that_waits_for_its_device():
    """As SIGTERM does on a busy machine: the handler has not returned when the wait should have been over."""
    devices = FakeDevices()
    devices.absent = "nothing there"
    clock = Clock()
    index_clock = IndexClock(RATE_HZ, clock, clock)
    slow = Patience(tick_s=0.4)
    card = SoundCard(InputSettings(), RATE_HZ, opener=devices, index_clock=index_clock, clock=clock, patience=slow)

    def stop(*_):
        card.stop()
        time.sleep(2 * slow.tick_s)

    before = signal.signal(signal.SIGUSR1, stop)
    threading.Timer(0.5 * slow.tick_s, os.kill, (os.getpid(), signal.SIGUSR1)).start()
    try:
        assert list(card.blocks()) == []
    finally:
        signal.signal(signal.SIGUSR1, before)
        card.close()


def test_a_device_that_opens_and_never_delivers():
    """While such a device is waited for the loss goes on; after 0.5 s it is frozen, too, and opened again."""
    with listening(FakeDevices()) as listener:
        device = listener.devices.opened()
        listener.clock.now_s += 1.1
        assert device.closed.wait(20.0)
        eventually(lambda: "frozen" in listener.card.condition().problems[0])
        eventually(lambda: listener.lost >= 1.0 * RATE_HZ)
        listener.devices.opened()
        listener.clock.now_s += 0.4
        eventually(lambda: listener.lost >= 1.4 * RATE_HZ)
