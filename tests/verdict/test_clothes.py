"""The same cut in other clothes gives the same verdicts; simulated cuts end to end, from samples to words."""

from __future__ import annotations

import numpy as np
import pytest
import soundfile
import soxr

from chatter_monitor.config import load
from chatter_monitor.physics.cuts import stable_turning
from chatter_monitor.physics.simulate import simulate
from chatter_monitor.records import Flag
from chatter_monitor.tracking.channel import Channel
from chatter_monitor.tracking.spindle import SpindleSettings
from chatter_monitor.verdict.evidence import weigh
from chatter_monitor.verdict.judge import Judge
from tests.replaying import REPLAY_DATA, replay
from tests.signals import RATE_HZ

RATE = int(RATE_HZ)
SETTINGS = load([])
# From a stable cut into chatter: the bar's truth is unstable from 5.95 s on.
EXCERPT_S = (4.0, 10.0)


def read(name):
    return soundfile.read(REPLAY_DATA / f"{name}.flac")[0]


@pytest.fixture(scope="module")
def cut():
    samples = read("bar_turning")
    return samples[round(EXCERPT_S[0] * RATE) : round(EXCERPT_S[1] * RATE)]


def judged(pieces, spindle=None, announced=None):
    """Verdicts of a signal in pieces (first sample, samples, flags); a spindle may be announced before a sample."""
    spindle = spindle or SpindleSettings()
    channel = Channel(SETTINGS.tracker, SETTINGS.orders, spindle)
    judge = Judge(SETTINGS.verdict)
    verdicts = []
    for first, samples, flags in pieces:
        if announced and first >= announced[0]:
            spindle = announced[1]
            channel.set_spindle(spindle)
            announced = None
        for each in channel.process(first, samples, flags):
            frame = each.odp
            verdicts.append(judge.verdict(weigh(each, spindle), frame.first_sample, len(frame), frame.sample_rate_hz))
    return verdicts


def of_whole(samples):
    return judged([(0, samples, Flag.NONE)])


def states(verdicts):
    return [verdict.state for verdict in verdicts]


@pytest.fixture(scope="module")
def plain(cut):
    verdicts = of_whole(cut)
    assert 1.9 < next(v.t0 for v in verdicts if v.state == "self_excited") < 3.5
    assert states(verdicts)[-40:] == ["self_excited"] * 40
    return verdicts


@pytest.mark.parametrize("gain", [1000.0, 0.001, -1.0])
def test_gain_and_polarity_do_not_matter(cut, plain, gain):
    """A thousand times as loud, as quiet, or upside down: the same state in every interval, at the same frequency."""
    other = of_whole(gain * cut)
    assert states(other) == states(plain)
    for one, two in zip(plain, other, strict=True):
        assert (one.frequency_hz is None) == (two.frequency_hz is None)
        if one.frequency_hz is not None:
            assert two.frequency_hz == pytest.approx(one.frequency_hz, rel=1e-3)


def test_the_second_channel_is_a_channel_of_its_own(cut, plain, tmp_path):
    """In a file with a stable cut on channel 0 and this one on channel 1, each has its own timeline."""
    calm = 0.5 * read("stable_turning")[: len(cut)]
    soundfile.write(tmp_path / "two.wav", np.stack([calm, cut], axis=1), RATE, subtype="FLOAT")
    outcome = replay(tmp_path / "two.wav", tmp_path)
    assert outcome.states(1) == states(plain)
    assert outcome.states(0) == states(of_whole(calm))
    assert {event["channel"] for event in outcome.of("event")} == {1}


@pytest.mark.parametrize("rate", [44_100, 48_000])
def test_the_rate_of_the_source_does_not_matter(cut, plain, tmp_path, rate):
    """From a file at another rate: the alarm begins within an interval of the same, and 95 % of intervals agree."""
    soundfile.write(tmp_path / "cut.wav", soxr.resample(cut, RATE, rate), rate, subtype="FLOAT")
    other = replay(tmp_path / "cut.wav", tmp_path).states()
    expected = states(plain)
    assert abs(other.index("self_excited") - expected.index("self_excited")) <= 1
    agree = [one == two for one, two in zip(other, expected, strict=False)]
    assert np.mean(agree) >= 0.95


def test_dropouts_of_a_millisecond_cost_only_their_intervals(cut, plain):
    """13 samples lost twice a second: unknown where they are, and the timeline of the whole signal everywhere else."""
    pieces, first = [], 0
    for lost in range(RATE // 4, len(cut), RATE // 2):
        pieces.append((first, cut[first:lost], Flag.NONE))
        first = lost + 13
    pieces.append((first, cut[first:], Flag.NONE))
    other = judged(pieces)
    lost = {at // 640 for begin in range(RATE // 4, len(cut), RATE // 2) for at in (begin, begin + 12)}
    assert {i for i, v in enumerate(other) if "gap" in v.flags} == lost
    assert all(other[i].state == "unknown" for i in lost)
    heard = [(one.state, two.state) for i, (one, two) in enumerate(zip(plain, other, strict=True)) if i not in lost]
    assert abs(states(other).index("self_excited") - states(plain).index("self_excited")) <= 2
    assert np.mean([one == two for one, two in heard]) >= 0.95
    assert "unknown" not in {two for _, two in heard[1:]}


def test_a_minute_of_silence_after_chatter():
    """When the machine stops the alarm ends at once, and a minute of noise floor is idle."""
    rng = np.random.default_rng(5)
    bar = read("bar_turning")[6 * RATE : 10 * RATE]
    silence = 1e-4 * np.std(bar) * rng.standard_normal(60 * RATE)
    seen = states(of_whole(np.concatenate([bar, silence])))
    assert "self_excited" in seen[:80]
    assert set(seen[82:]) == {"idle"}


@pytest.mark.parametrize("before", ["zeros", "noise floor"])
def test_a_stable_cut_that_begins_is_no_chatter(before):
    """When a stable cut begins after ten seconds in which nothing was cut, there is no alarm."""
    cut = read("stable_turning")[: 4 * RATE]
    floor = 0.0 if before == "zeros" else 1e-4 * np.std(cut)
    silence = floor * np.random.default_rng(5).standard_normal(10 * RATE)
    assert "self_excited" not in states(of_whole(np.concatenate([silence, cut])))


def test_digital_silence_is_idle():
    """A minute of zeros is neither an alarm nor stable: nothing moves."""
    assert set(states(of_whole(np.zeros(60 * RATE)))[1:]) == {"idle"}


@pytest.mark.parametrize("seed", range(3))
def test_noise_is_no_chatter(seed):
    """Half a minute of white noise is stable throughout."""
    noise = np.random.default_rng([7, seed]).standard_normal(30 * RATE)
    assert set(states(of_whole(noise))[1:]) == {"stable"}


def test_a_stable_simulated_cut_is_stable():
    """Half a minute of turning at 15 % of the limit never alarms, though its mode stands out."""
    simulation = simulate(stable_turning(), 30.0, 11, RATE, settle_s=0.5)
    assert "self_excited" not in states(of_whole(simulation.signal))


def test_an_announced_speed_names_the_orders():
    """When a speed is announced in the middle of a forced cut, its lines become orders of it; no alarm on the way."""
    forced = read("forced_milling")
    pieces = [(first, forced[first : first + 1280], Flag.NONE) for first in range(0, len(forced), 1280)]
    mill = SpindleSettings(speed_rpm=1656.0, teeth=6)
    verdicts = judged(pieces, announced=(5 * RATE, mill))
    assert "self_excited" not in states(verdicts)
    after = [verdict for verdict in verdicts if verdict.t0 >= 6.0]
    assert np.mean([verdict.state == "forced" for verdict in after]) > 0.95
    strongest = [verdict.order for verdict in after if verdict.state == "forced"]
    assert np.median(strongest) == pytest.approx(36.0, abs=0.2)


def test_an_announced_speed_changes_no_alarm(cut, plain):
    """A speed that is announced while it chatters leaves the alarm as it is."""
    pieces = [(first, cut[first : first + 1280], Flag.NONE) for first in range(0, len(cut), 1280)]
    verdicts = judged(pieces, announced=(4 * RATE, SpindleSettings(speed_rpm=1685.0, teeth=1)))
    assert states(verdicts)[-40:] == states(plain)[-40:] == ["self_excited"] * 40
