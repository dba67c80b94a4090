"""What turns: found, followed, taken out, and nothing else with it."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chatter_monitor.tracking.orders import OrderSettings, OrderTracker
from chatter_monitor.tracking.spindle import SpindleSettings
from tests.signals import RATE_HZ

UNKNOWN = SpindleSettings()
MILLING = {1: 0.3, 2: 0.1, 4: 1.0, 8: 0.7, 12: 0.5, 16: 0.2}
TURNS_HZ = 28.15
GIVEN = SpindleSettings(60 * 27.6, 4)  # 2 % off


def noise(seconds, level=0.1, seed=1):
    return level * np.random.default_rng(seed).standard_normal(round(seconds * RATE_HZ))


def comb(seconds, rotation_hz, amplitudes):
    """Harmonics {order: amplitude} of a speed in Hz, constant or at every sample."""
    angle = 2 * np.pi * np.cumsum(np.broadcast_to(rotation_hz, round(seconds * RATE_HZ))) / RATE_HZ
    return sum(a * np.cos(h * angle + h) for h, a in amplitudes.items())


def take_out(samples, spindle=UNKNOWN, block=3200):
    tracker = OrderTracker(OrderSettings(), RATE_HZ, spindle)
    residuals, frames = [], []
    for first in range(0, len(samples), block):
        residual, ended = tracker.process(first, samples[first : first + block])
        residuals.append(residual)
        frames += ended
    return np.concatenate(residuals), [*frames, *tracker.finish()]


def at(seconds):
    return round(seconds * RATE_HZ)


def power(samples, begin, end=None):
    return float(np.mean(samples[at(begin) : end and at(end)] ** 2))


@pytest.mark.parametrize(("spindle", "source", "time_s"), [(UNKNOWN, "found", 2.6), (GIVEN, "refined", 1.55)])
def test_a_comb_is_found_and_taken_out(spindle, source, time_s):
    """Of a comb 2 % off the given speed, or of unknown speed, less than 1 % remains, from 1.55 or 2.6 s on."""
    residual, frames = take_out(comb(6, TURNS_HZ, MILLING) + noise(6), spindle)
    late = frames[round(time_s / 0.05) :]
    assert {frame.source for frame in late} == {source}
    assert all(abs(frame.rotation_hz - TURNS_HZ) < 0.03 for frame in late)
    assert {line.order for line in late[-1].lines} == set(MILLING)
    strongest = late[-1].lines[0]
    assert strongest.order == 4
    assert strongest.rms == pytest.approx(np.sqrt(0.5), rel=0.1)
    assert strongest.frequency_hz == pytest.approx(4 * TURNS_HZ, abs=0.1)
    assert power(residual - noise(6), time_s) < 0.01 * power(comb(6, TURNS_HZ, MILLING), time_s)
    assert late[-1].synchronous_share > 0.95


def test_two_lines_of_the_teeth_are_enough_where_the_speed_is_told():
    """They are taken out and followed while the spindle gets faster by a quarter; at unknown speed they are left."""
    rotation_hz = TURNS_HZ * (1.0 + 0.25 * np.clip((np.arange(at(12.0)) / RATE_HZ - 2.5) / 7.0, 0.0, 1.0))
    signal = comb(12.0, rotation_hz, {4: 1.0, 8: 0.5})
    residual, frames = take_out(signal + noise(12.0), GIVEN)
    assert {frame.source for frame in frames[at(1.55) // at(0.05) :]} == {"refined"}
    assert frames[-1].rotation_hz == pytest.approx(1.25 * TURNS_HZ, rel=1e-3)
    assert power(residual - noise(12.0), 1.55) < 0.02 * power(signal, 1.55)
    residual, frames = take_out(signal + noise(12.0))
    assert {frame.source for frame in frames} == {None}


def test_what_comes_before_a_comb_is_known_passes():
    """Until something is found the samples are untouched, and the given speed is reported as given."""
    samples = comb(1, TURNS_HZ, MILLING) + noise(1)
    residual, frames = take_out(samples, GIVEN)
    np.testing.assert_array_equal(residual, samples)
    assert {(frame.source, frame.rotation_hz, frame.synchronous_share) for frame in frames} == {("given", 27.6, 0.0)}


def test_nothing_is_found_in_noise():
    """White noise has no comb, and passes untouched."""
    samples = noise(7, 1.0)
    residual, frames = take_out(samples)
    np.testing.assert_array_equal(residual, samples)
    assert {frame.source for frame in frames} == {None}


@pytest.mark.parametrize("corner_hz", [0.1, 1.0])
def test_a_wandering_speed_is_followed(corner_hz):
    """Of a comb whose speed swings by 0.3 % less than 2 % remains; the speed is known to 0.15 %."""
    t = np.arange(at(8)) / RATE_HZ
    rotation_hz = TURNS_HZ * (1 + 0.003 * np.sqrt(2) * np.sin(2 * np.pi * corner_hz * t))
    clean = comb(8, rotation_hz, MILLING)
    residual, frames = take_out(clean + noise(8), GIVEN)
    assert power(residual - noise(8), 3) < 0.02 * power(clean, 3)
    off = [frame.rotation_hz / rotation_hz[640 * i + 640] - 1 for i, frame in enumerate(frames[:-1]) if i >= 60]
    assert np.sqrt(np.mean(np.square(off))) < 1.5e-3


def test_faint_orders_tell_a_wandering_line_of_the_teeth():
    """An order that wanders by 0.3 % has skirts as loud as the other ones, 30 dB fainter; they tell it all the same."""
    t = np.arange(at(6)) / RATE_HZ
    rotation_hz = 97.4 * (1 + 0.003 * np.sin(2 * np.pi * 0.3 * t))
    clean = comb(6, rotation_hz, {1: 0.03, 2: 0.03, 3: 1.0, 4: 0.03, 5: 0.03})
    residual, frames = take_out(clean + noise(6, 0.02))
    assert {frame.source for frame in frames[60:]} == {"found"}
    assert all(abs(frame.rotation_hz - 97.4) < 0.004 * 97.4 for frame in frames[60:])
    assert power(residual - noise(6, 0.02), 4) < 0.05 * power(clean, 4)


def test_a_comb_is_heard_in_step_with_its_loudest_line():
    """Where the others are fainter than its skirts in every window; as loud a vibration of its own is left alone."""
    t = np.arange(at(7)) / RATE_HZ
    rotation_hz = 97.4 * (1 + 0.003 * np.sin(2 * np.pi * 0.9 * t))
    clean = comb(7, rotation_hz, {3: 1.0, **dict.fromkeys((2, 10, 11, 13, 16), 0.015)})
    _, frames = take_out(clean + noise(7, 0.02))
    assert {frame.source for frame in frames[80:]} == {"found"}
    assert all(abs(frame.rotation_hz - 97.4) < 0.004 * 97.4 for frame in frames[80:])
    vibration = comb(7, 221.0 * (1 + 0.003 * np.sin(2 * np.pi * 0.9 * t)), {1: 1.0, 2: 0.1, 3: 0.1, 4: 0.03, 5: 0.02})
    _, frames = take_out(vibration + noise(7, 0.02))
    assert {frame.source for frame in frames} == {None}


@pytest.mark.parametrize("phase", [0.0, 4.5])
@pytest.mark.parametrize(
    "amplitudes",
    [{3: 1.0, **dict.fromkeys((1, 2, 4, 5, 7), 0.3)}, {3: 1.0, **dict.fromkeys((2, 10, 11, 13, 16), 0.015)}],
)
def test_a_speed_that_swings_is_known_as_soon_as_a_window_is_whole(amplitudes, phase):
    """Wherever the swing of 0.8 % is at the begin of the window and at its end; in step with the loudest line, too."""
    swing = 0.008 * np.sin(2 * np.pi * 0.9 * np.arange(at(4)) / RATE_HZ + phase)
    _, frames = take_out(comb(4, 97.4 * (1 + swing), amplitudes) + noise(4, 0.02))
    assert {frame.source for frame in frames[52:]} == {"found"}
    assert all(abs(frame.rotation_hz - 97.4) < 0.012 * 97.4 for frame in frames[52:])


def test_a_told_spindle_is_followed_beside_the_mains():
    """Three lines of its teeth, among twelve that hum three times as loud."""
    hum = comb(5, 60.0, dict.fromkeys(range(1, 13), 1.0))
    teeth = comb(5, 26.37, {6: 0.3, 12: 0.3, 18: 0.2})
    _, frames = take_out(hum + teeth + noise(5), SpindleSettings(60 * 26.0, 6))
    assert {frame.source for frame in frames[60:]} == {"refined"}
    assert all(frame.rotation_hz == pytest.approx(26.37, abs=0.02) for frame in frames[60:])


def test_a_pump_near_the_teeth_is_not_taken_for_them_for_long():
    """It is followed as the told teeth while nothing is cut; those of a tool that enters are heard beside it."""
    pump = comb(8, 100.2, {3: 1.0, 6: 0.2})
    teeth = np.where(np.arange(at(8)) < at(3), 0.0, comb(8, 94.8, dict.fromkeys((1, 2, 3, 4, 5, 6, 9), 0.7)))
    _, frames = take_out(pump + teeth + noise(8), SpindleSettings(60 * 97.5, 3))
    assert frames[55].rotation_hz == pytest.approx(100.2, abs=0.1)
    assert all(frame.rotation_hz == pytest.approx(94.8, abs=0.1) for frame in frames[130:])


def test_a_new_speed_is_gone_by():
    """After set_spindle the comb of the new speed is found, within 3 s, and the old one is given up at once."""
    samples = np.concatenate([comb(4, TURNS_HZ, MILLING), comb(6, 40.4, MILLING)]) + noise(10)
    tracker = OrderTracker(OrderSettings(), RATE_HZ, GIVEN)
    _, before = tracker.process(0, samples[: at(4)])
    tracker.set_spindle(SpindleSettings(60 * 40, 4))
    residual, after = tracker.process(at(4), samples[at(4) :])
    assert before[-1].source == "refined"
    assert (after[0].source, after[0].rotation_hz) == ("given", 40.0)
    assert all(frame.source == "refined" and abs(frame.rotation_hz - 40.4) < 0.1 for frame in after[60:])
    assert power(residual, 3) < 0.03


def test_a_speed_that_is_not_true_any_more_is_doubted():
    """Within 3.4 s what turns is taken out as if nothing had been told, until it turns as fast as was told."""
    stale = SpindleSettings(60.0 * 41.0, 4)
    turns = np.concatenate([comb(6, TURNS_HZ, MILLING), np.zeros(at(12.0)), comb(6, 41.4, MILLING)]) + noise(24)
    residual, frames = take_out(turns, stale)
    other, again = frames[68:118], frames[-60:]
    assert {(frame.source, frame.doubted) for frame in other} == {("found", True)}
    assert all(abs(frame.rotation_hz - TURNS_HZ) < 0.03 for frame in other)
    assert power(residual, 3.4, 5.9) < 0.02 * power(turns, 3.4, 5.9)
    assert {(frame.source, frame.doubted) for frame in again} == {("refined", False)}
    assert all(abs(frame.rotation_hz - 41.4) < 0.04 for frame in again)


def test_a_speed_that_is_told_is_believed_at_first():
    """Also if another was doubted just now."""
    tracker = OrderTracker(OrderSettings(), RATE_HZ, SpindleSettings(60.0 * 41.0, 3))
    _, frames = tracker.process(0, comb(4, TURNS_HZ, MILLING) + noise(4))
    assert frames[-1].doubted
    tracker.set_spindle(GIVEN)
    _, frames = tracker.process(at(4.0), noise(0.1))
    assert not frames[0].doubted


@pytest.mark.parametrize(
    ("beside", "level"),
    [
        ({1: 1.0, 2: 0.7, 3: 0.5, 4: 0.3, 5: 0.2}, 0.1),  # a belt
        ({4: 1.0, 8: 0.7, 12: 0.5, 16: 0.3}, 0.02),
    ],
)
def test_what_another_machine_turns_is_no_doubt(beside, level):
    """As long as the spindle is heard as well; when it is heard again after that machine was alone, none is left."""
    spindle = np.concatenate([comb(6, TURNS_HZ, MILLING), np.zeros(at(5.0)), comb(5, TURNS_HZ, MILLING)])
    _, frames = take_out(spindle + comb(16, 33.7, beside) + noise(16, level), GIVEN)
    assert not any(frame.doubted for frame in (*frames[:120], *frames[-40:]))


def test_a_comb_that_is_heard_is_followed_out_of_the_range_of_its_speed():
    """A spindle that slows down by a sixth in ten seconds goes on being taken out, whatever speed was told."""
    speeds_hz = TURNS_HZ * (1.0 - 0.0167 * np.clip(np.arange(at(14)) / RATE_HZ - 3.0, 0.0, 10.0))
    residual, frames = take_out(comb(14, speeds_hz, MILLING) + noise(14), GIVEN)
    assert frames[-2].rotation_hz == pytest.approx(speeds_hz[-1], rel=1e-3)
    assert all(frame.synchronous_share > 0.9 for frame in frames[40:])
    assert power(residual, 3) < 0.03


@pytest.mark.parametrize("spindle", [UNKNOWN, GIVEN])
def test_nothing_of_a_comb_is_heard_in_the_air(spindle):
    """When the tool has left, what was taken out is not subtracted from the air: two rotations later it is the room."""
    samples = comb(8, TURNS_HZ, MILLING) * (np.arange(at(8)) < at(5)) + noise(8, 0.01)
    residual, frames = take_out(samples, spindle)
    assert frames[95].synchronous_share > 0.95
    assert power(residual, 5.15, 6.5) < 1.5 * 0.01**2


@pytest.mark.parametrize(("beside", "returns"), [(0.0, True), (100.0, False)])
def test_it_tells_when_what_turns_is_in_the_signal_again(beside, returns):
    """A comb is let go that had most of the power: in the frame after it its lines are in the signal again.

    They are next to nothing of it if something else has become much louder just then.
    """
    tracker = OrderTracker(OrderSettings(), RATE_HZ, GIVEN)
    samples = comb(8, TURNS_HZ, MILLING) + noise(8)
    samples[at(4) :] += beside * np.sin(2 * np.pi * 8.36 * TURNS_HZ * np.arange(len(samples) - at(4)) / RATE_HZ)
    _, before = tracker.process(0, samples[: at(4)])
    tracker.set_spindle(SpindleSettings(60 * 40, 4))
    _, after = tracker.process(at(4), samples[at(4) :])
    assert before[-1].synchronous_share > 0.95
    told = [frame.returned for frame in before + after]
    assert told == [False] * len(before) + [returns] + [False] * (len(after) - 1)


@pytest.mark.parametrize("spindle", [SpindleSettings(60 * TURNS_HZ, 4), UNKNOWN])
def test_a_rotation_that_is_remembered_is_not_heard(spindle):
    samples = np.concatenate((comb(5, TURNS_HZ, MILLING), np.zeros(at(1)))) + noise(6)
    _, frames = take_out(samples, spindle)
    heard = [frame.rotation_heard for frame in frames]
    assert not heard[0]
    assert all(heard[80:100])
    assert not any(heard[102:])


@pytest.mark.parametrize(("next_cut", "heard"), [(MILLING, True), ({15: 0.5, 30: 0.3}, False), ({4: 0.5}, True)])
def test_the_lines_of_another_job_are_not_the_spindle(next_cut, heard):
    """Two of its lines may be on orders of the speed before, but are then a comb of the first of them."""
    samples = np.concatenate((comb(5, TURNS_HZ, MILLING), np.zeros(at(1)), comb(3, TURNS_HZ, next_cut))) + noise(9)
    _, frames = take_out(samples, GIVEN)
    assert all(frame.spindle_heard for frame in frames[80:100])
    assert any(frame.rotation_heard for frame in frames[120:135])  # something turns
    assert any(frame.spindle_heard for frame in frames[120:]) is heard
    assert all(frame.spindle_heard for frame in frames[135:180]) is heard


def test_a_speed_that_wandered_is_remembered_as_it_was_heard_last():
    """What follows it goes on for a while, through noise, and strays: by 1.7 % here."""
    t = np.arange(at(8)) / RATE_HZ
    wandering = comb(8, TURNS_HZ * (1 + 0.006 * np.sin(2 * np.pi * t)), MILLING)
    _, frames = take_out(np.concatenate((wandering, np.zeros(at(1.4)))) + noise(9.4, 0.03), GIVEN)
    for frame in frames[162:]:
        assert frame.source == "refined"
        assert frame.rotation_hz == pytest.approx(TURNS_HZ, rel=1e-3)
        assert frame.rotation_sd_hz < 0.004 * TURNS_HZ


@pytest.mark.parametrize("off", [0.3, 0.1, 0.05])
def test_a_vibration_beside_an_order_stays(off):
    """A vibration that starts 0.05 orders beside an order or farther keeps 80 % of its amplitude from the start on."""
    t = np.arange(at(10)) / RATE_HZ
    line = np.where(t >= 5, np.cos(2 * np.pi * (20 + off) * 60.0 * t), 0.0)
    residual, frames = take_out(comb(10, 60.0, MILLING) + noise(10) + line, SpindleSettings(60 * 59.0, 4))
    assert frames[-1].source == "refined"
    for begin, end in ((5.0, 5.05), (5.05, 6.0), (6.0, 10.0)):
        there = slice(at(begin), at(end))
        kept = residual[there] @ line[there] / (line[there] @ line[there])
        assert 0.8 < kept < 1.2


def test_growth_on_an_order_passes():
    """A vibration that grows tenfold in 0.25 s exactly on an order is let through while it grows."""
    t = np.arange(at(7)) / RATE_HZ
    line = 1e-3 * np.exp(9.2 * np.clip(t - 5, 0, 0.8)) * np.cos(2 * np.pi * 20 * 60.0 * t)
    residual, _ = take_out(comb(7, 60.0, MILLING) + noise(7, 0.03) + line, SpindleSettings(60 * 59.0, 4))
    there = slice(at(5.4), at(5.8))
    assert residual[there] @ line[there] > 0.7 * line[there] @ line[there]


@pytest.mark.parametrize("spindle", [UNKNOWN, GIVEN])
def test_a_load_makes_all_of_a_comb_louder_and_that_is_followed_at_once(spindle):
    """Within two frames of becoming six times as loud a tenth of its power is left."""
    signal = comb(6, TURNS_HZ, MILLING) * np.where(np.arange(at(6)) < at(4), 1.0, 6.0)
    residual, frames = take_out(signal + noise(6), spindle)
    assert power(residual, 4.1) < 0.1 * power(signal, 4.1)
    assert {frame.source for frame in frames[80:]} == {frames[79].source} != {None}


def test_a_few_lines_that_get_louder_together_are_no_load():
    """Chatter that has locked to the teeth is a comb of a few lines, too: most of it stays in the signal."""
    few = comb(6, TURNS_HZ, {4: 1.0, 8: 0.7, 12: 0.5})
    signal = few * np.where(np.arange(at(6)) < at(4), 1.0, 6.0)
    residual, _ = take_out(signal + noise(6), GIVEN)
    assert power(residual, 3.5, 4) < 0.1 * power(signal, 3.5, 4)
    assert power(residual, 4, 4.2) > 0.5 * power(signal, 4, 4.2)


@pytest.mark.parametrize("order", [4, 8])
def test_what_jumps_on_one_order_of_many_is_no_load(order):
    """Ten times as loud on an order that is in the comb, at once: most of it stays in the signal, and no other goes."""
    line = np.where(np.arange(at(6)) < at(4), 0.0, comb(6, TURNS_HZ, {order: 9.0 * MILLING[order]}))
    residual, _ = take_out(comb(6, TURNS_HZ, MILLING) + line + noise(6), GIVEN)
    there = slice(at(4), at(4.2))
    others = comb(6, TURNS_HZ, MILLING | {order: 0.0})[there]
    assert residual[there] @ line[there] > 0.7 * line[there] @ line[there]
    assert abs(residual[there] @ others) < 0.3 * others @ others


@pytest.mark.parametrize("spindle", [UNKNOWN, SpindleSettings(60 * 60.5, 3)])
def test_chatter_with_sidebands_stays(spindle):
    """A self-excited vibration at 19.4 orders with sidebands at the tooth passing frequency is no comb, and stays."""
    t = np.arange(at(8)) / RATE_HZ
    around = 1 + 0.6 * np.cos(2 * np.pi * 180 * t) + 0.4 * np.cos(2 * np.pi * 360 * t)
    chatter = around * np.cos(2 * np.pi * 19.4 * 60.0 * t)
    residual, frames = take_out(chatter + noise(8), spindle)
    assert all(frame.source in (None, "given") for frame in frames)
    assert power(residual, 4) > 0.99 * power(chatter + noise(8), 4)


@pytest.mark.parametrize("spindle", [UNKNOWN, SpindleSettings(60 * 60.5, 3)])
def test_sidebands_are_told_as_long_as_they_are_there(spindle):
    """Within 1.5 windows of the first sample, as long after the last one, and not from across missing samples."""
    t = np.arange(at(16)) / RATE_HZ
    around = 1 + 0.3 * np.cos(2 * np.pi * 180 * t) + 0.1 * np.cos(2 * np.pi * 360 * t)
    chatter = around * np.cos(2 * np.pi * 19.43 * 60.0 * t) + 0.2 * np.cos(2 * np.pi * 2 * 19.43 * 60.0 * t)
    samples = (
        np.where((t > 2.0) & (t < 8.0), chatter, 0.0) + comb(16, 60.0, {3: 0.05, 6: 0.03, 9: 0.02}) + noise(16, 0.01)
    )
    samples[at(12.0)] = np.nan
    samples[at(12.1) :] += chatter[at(12.1) :]
    _, frames = take_out(samples, spindle)
    told = [frame.sidebands for frame in frames]
    heard = [i for i, sidebands in enumerate(told) if sidebands is not None]
    assert 2.0 < 0.05 * heard[0] < 2.0 + 1.5 * 2.55
    assert all(told[heard[0] : round(8.0 / 0.05)])
    assert not any(told[round((8.0 + 1.5 * 2.55) / 0.05) : round((12.1 + 2.55) / 0.05)])
    assert told[heard[-1]].carrier_hz == pytest.approx(19.43 * 60.0, abs=0.5)
    assert told[heard[-1]].spacing_hz / 60.0 == pytest.approx(3, abs=0.01)


@pytest.mark.parametrize("before", [0.5, 2.0])
def test_sidebands_are_told_though_other_lines_have_just_gone(before):
    """Of another cut, and fainter or louder: within half a window and one search, not when all of it has been left."""
    t = np.arange(at(7)) / RATE_HZ
    around = 1 + 0.3 * np.cos(2 * np.pi * 180 * t) + 0.1 * np.cos(2 * np.pi * 360 * t)
    chatter = around * np.cos(2 * np.pi * 19.43 * 60.0 * t) + 0.2 * np.cos(2 * np.pi * 2 * 19.43 * 60.0 * t)
    others = before * sum(np.cos(2 * np.pi * hertz * t) for hertz in np.random.default_rng(2).uniform(200.0, 3000.0, 8))
    _, frames = take_out(np.where(t < 5.0, others, chatter) + noise(7, 0.01), UNKNOWN)
    told = [frame.sidebands for frame in frames if frame.sidebands is not None]
    assert told[-1].carrier_hz == pytest.approx(19.43 * 60.0, abs=0.5)
    assert told[-1].spacing_hz == pytest.approx(180.0, abs=0.5)


@pytest.mark.parametrize("spindle", [UNKNOWN, SpindleSettings(60 * 60.5, 3)])
def test_sidebands_of_a_vibration_that_wanders_are_told(spindle):
    """Each is as broad as that is, too broad for a line; in step with the vibration all are narrow."""
    t = np.arange(at(8)) / RATE_HZ
    angle = 2 * np.pi * np.cumsum(1031.0 * (1 + 0.003 * np.sin(2 * np.pi * 0.9 * t))) / RATE_HZ
    teeth = 2 * np.pi * 3 * 60.0 * t
    around = 1 + 0.3 * sum(np.cos(n * teeth + n) for n in (1, 2, 3))
    chatter = around * np.cos(angle) + 0.15 * (1 + 0.3 * np.cos(teeth)) * np.cos(2 * angle)
    _, frames = take_out(chatter + noise(8, 0.03), spindle)
    told = [frame.sidebands for frame in frames[100:]]
    assert all(told)
    assert all(round(180.0 / each.spacing_hz) * each.spacing_hz == pytest.approx(180.0, rel=5e-3) for each in told)
    assert all(each.spacing_hz > 59.0 for each in told)  # of the rotation or the teeth
    assert all(each.carrier_hz == pytest.approx(1031.0, rel=4e-3) for each in told)


def test_sidebands_are_told_among_many_louder_lines_of_a_spindle():
    """A single tooth that strikes has more lines than are looked at, all louder; it is known, and few of it will do."""
    t = np.arange(at(8)) / RATE_HZ
    around = 1 + 0.1 * sum(np.cos(2 * np.pi * n * 30.5 * t + n) for n in (1, 2, 3, 4, 5))
    chatter = around * np.cos(2 * np.pi * 10.42 * 30.5 * t)
    strikes = comb(8, 30.5, dict.fromkeys(range(1, 28), 0.15))
    _, frames = take_out(chatter + strikes + noise(8, 0.003), SpindleSettings(60 * 30.6, 1))
    told = [frame.sidebands for frame in frames[120:]]
    assert all(told)
    assert all(each.carrier_hz == pytest.approx(10.42 * 30.5, abs=0.5) for each in told)


def test_the_mains_are_not_given_up_for_sidebands():
    """A vibration that begins at one of their high multiples is none of them; what hums goes on to be taken out."""
    t = np.arange(at(10)) / RATE_HZ
    around = 1 + 0.3 * sum(np.cos(2 * np.pi * n * 183.4 * t + n) for n in (1, 2, 3, 4))
    chatter = around * (np.cos(2 * np.pi * 1900.2 * t) + 0.3 * np.cos(2 * np.pi * 2 * 1900.2 * t))
    hum = comb(10, 50.0, {2: 0.5, 4: 0.3, 6: 0.3})
    samples = np.where(t > 4.0, chatter, 0.0) + noise(10, 0.01)
    residual, frames = take_out(samples + hum, UNKNOWN)
    assert frames[-1].sidebands.carrier_hz == pytest.approx(1900.2, abs=0.5)
    assert power(residual, 9) == pytest.approx(power(samples, 9), rel=0.05)


@pytest.mark.parametrize("spindle", [UNKNOWN, GIVEN])
def test_what_turns_has_no_sidebands(spindle):
    """Not even one that is told 2 % off, with teeth that are not alike, before it is found or after."""
    _, frames = take_out(
        comb(8, TURNS_HZ, {1: 0.3, 2: 0.1, 4: 1.0, 7: 0.2, 8: 0.7, 12: 0.5, 15: 0.8}) + noise(8), spindle
    )
    assert all(frame.sidebands is None for frame in frames)


def test_a_second_comb_is_taken_out_too():
    """The mains' comb beside the spindle's is taken out of what the spindle leaves; it is reported as the other."""
    mains = comb(10, 50.0, {1: 0.2, 3: 0.5, 5: 0.3, 7: 0.2, 9: 0.2})
    residual, frames = take_out(comb(10, TURNS_HZ, MILLING) + mains + noise(10), GIVEN)
    assert frames[-1].rotation_hz == pytest.approx(TURNS_HZ, abs=0.03)
    part = 50.0 / frames[-1].other_hz  # of the mains' frequency, when weak lines beside its own suggest one
    assert part == pytest.approx(round(part), abs=0.01)
    assert {round(line.frequency_hz) for line in frames[-1].other_lines[:5]} == {50, 150, 250, 350, 450}
    assert power(residual, 7) < 0.02


@pytest.mark.parametrize("mains_hz", [50.04, 59.97])
def test_the_mains_are_taken_out_though_the_spindle_is_not_heard(mains_hz):
    """They go on as the machine does, and are no doubt of its speed."""
    hum = comb(6, mains_hz, {1: 1.0, 2: 0.3, 3: 0.6, 5: 0.4, 7: 0.2}) + noise(6)
    residual, frames = take_out(hum, GIVEN)
    assert power(residual, 4.0) < 0.02 * power(hum, 4.0)
    assert (frames[-1].source, frames[-1].doubted) == ("given", False)
    assert frames[-1].other_hz == pytest.approx(mains_hz, abs=0.03)


def test_missing_samples_freeze_it():
    """After 0.3 s of missing samples, skipped or not finite, the comb is taken out from the next sample on."""
    samples = comb(6, TURNS_HZ, MILLING) + noise(6)
    for skip in (True, False):
        tracker = OrderTracker(OrderSettings(), RATE_HZ, GIVEN)
        _, first = tracker.process(0, samples[: at(4)])
        gap = np.full(at(4.3) - at(4), np.nan)
        if not skip:
            lost, more = tracker.process(at(4), gap)
            assert np.isnan(lost).all()
            first += more
        residual, rest = tracker.process(at(4.3), samples[at(4.3) :])
        assert np.isfinite(residual).all()
        assert power(residual, 0, 0.05) < 0.1
        assert power(residual, 0.3) < 0.02
        assert [frame.first_sample for frame in first + rest] == list(range(0, at(6), 640))


def test_gain_does_not_matter():
    """The samples times 2^20 or 2^-20 give the residual times the same, bit by bit, and the same speeds."""
    samples = comb(4, TURNS_HZ, MILLING) + noise(4)
    expected, frames = take_out(samples, GIVEN)
    for gain in (2.0**20, 2.0**-20):
        residual, scaled = take_out(gain * samples, GIVEN)
        np.testing.assert_allclose(residual, gain * expected, rtol=1e-6, atol=1e-9 * gain)
        assert [frame.rotation_hz for frame in scaled] == pytest.approx([frame.rotation_hz for frame in frames])


@settings(max_examples=10, derandomize=True, deadline=None)
@given(st.lists(st.integers(1, 30_000), min_size=1, max_size=8))
def test_any_blocks_give_the_same_bits(sizes):
    """Residual and frames are the same for any cuts between the blocks, missing samples included."""
    samples = comb(4, 40.0, MILLING) + noise(4)
    samples[45_000:45_100] = np.nan
    spindle = SpindleSettings(60 * 40.3, 4)
    whole, frames = take_out(samples, spindle, block=len(samples))
    tracker = OrderTracker(OrderSettings(), RATE_HZ, spindle)
    edges = [0, *np.minimum(np.cumsum(sizes), len(samples)).tolist(), len(samples)]
    pieces = [tracker.process(a, samples[a:b]) for a, b in pairwise(edges)]
    assert np.concatenate([residual for residual, _ in pieces]).tobytes() == whole.tobytes()
    np.testing.assert_equal([frame for _, ended in pieces for frame in ended] + tracker.finish(), frames)
    assert frames[-1].source == "refined"


LOCKED = {14: 0.5, 16: 0.6, 17: 1.0, 19: 0.8, 20: 0.5, 22: 0.3}  # of a third of the teeth's passing


@pytest.mark.parametrize(("spindle", "taken"), [(SpindleSettings(60 * TURNS_HZ, 4), False), (UNKNOWN, True)])
def test_chatter_that_has_locked_to_the_teeth_stays_in_the_signal(spindle, taken):
    """What comes back after three teeth is a comb, and steady; without a speed it may be that of the spindle."""
    begins = 4.0
    chatter = np.where(np.arange(at(9)) < at(begins), 0.0, comb(9, 4 * TURNS_HZ / 3, LOCKED))
    residual, frames = take_out(comb(9, TURNS_HZ, MILLING) + chatter + noise(9), spindle)
    left = power(residual, 8.0) / power(chatter, 8.0)
    assert left < 0.1 if taken else left == pytest.approx(1.0, abs=0.1)
    assert (frames[-1].other_hz is not None) is taken


def test_chatter_that_has_locked_to_the_spindle_does_not_speak_against_its_speed():
    """Every other rotation is alike, and the spindle was lost just before: that is no other speed."""
    before = comb(4, TURNS_HZ, {1: 0.3, 2: 0.5, 3: 1.0, 5: 0.7, 8: 0.4})
    flip = comb(6, TURNS_HZ / 2, dict.fromkeys(range(7, 25), 1.0))
    samples = np.concatenate((before, np.zeros(at(2)), flip)) + noise(12)
    _, frames = take_out(samples, SpindleSettings(60 * TURNS_HZ, 1))
    assert not any(frame.doubted for frame in frames)
    assert frames[-1].source == "refined"
    assert frames[-1].rotation_hz == pytest.approx(TURNS_HZ, rel=1e-3)


@pytest.mark.parametrize(("spindle", "known"), [(SpindleSettings(60 * TURNS_HZ, 4), 1.6), (UNKNOWN, 2.7)])
def test_what_comes_back_is_told_once_a_rotation_is_known(spindle, known):
    """And goes on being told by that rotation where another comb has locked to it."""
    begins = 4.0
    loud = np.where(np.arange(at(9)) < at(begins), 0.0, 2.0)
    samples = comb(9, TURNS_HZ, MILLING) + loud * comb(9, 4 * TURNS_HZ / 3, LOCKED) + noise(9)
    _, frames = take_out(samples, spindle)
    shares = np.array([frame.recurring_share for frame in frames], float)
    assert np.all(np.isnan(shares[: round(1.5 / 0.05)]))
    assert np.all(shares[round(known / 0.05) : round(begins / 0.05)] > 0.95)
    assert np.all(shares[round(begins / 0.05) + 2 : -1] < 0.7)
    _, frames = take_out(comb(6, 50.0, MILLING) + noise(6))  # the mains minds no tool
    assert {frame.recurring_share for frame in frames} == {None}
