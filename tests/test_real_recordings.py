"""Recordings of real machines, where they are at hand: they are not part of the project."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import soundfile
import soxr

from benchmarks.verdict.altered import RECORDINGS, Altered, told
from chatter_monitor.config import load
from chatter_monitor.tracking.channel import Channel
from tests.replaying import replay
from tests.signals import RATE_HZ

DATA = Path(__file__).parents[2] / "shared" / "data"
CLOTHES = (Altered(times=0.9), Altered(times=1.05), Altered(times=1.25), Altered(snr_db=10.0))


def path_of(name):
    if not (DATA / name).is_file():
        pytest.skip(f"{name} is not in ../shared/data: recordings of real machines are not part of the project")
    return DATA / name


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """Replay a recording without any speed given; each once."""
    outcomes = {}

    def replayed(name):
        path = path_of(name)
        if name not in outcomes:
            outcomes[name] = replay(path, tmp_path_factory.mktemp("real"))
        return outcomes[name]

    return replayed


def test_milling_chatter_is_found_where_it_is(replayed):
    """The alarm lies within 7 to 17.5 s and covers most of 8 to 17.5 s."""
    alarms = replayed("ubc_milling_chatter.flac").alarms()
    assert sum(alarm["t1"] - alarm["t0"] for alarm in alarms) > 0.75 * (17.5 - 8)
    assert 7 <= alarms[0]["t0"] <= 8.5
    assert 16 <= alarms[-1]["t1"] <= 17.5


def test_milling_chatter_has_its_frequency(replayed):
    """In every interval of the alarm in which its line is heard, nine in ten at least: 1060 to 1080 Hz."""
    outcome = replayed("ubc_milling_chatter.flac")
    heard = [alarm["frequency_hz"] for alarm in outcome.alarms() if alarm["frequency_hz"] is not None]
    assert len(heard) > 0.9 * len(outcome.alarms())
    assert all(1060 <= frequency_hz <= 1080 for frequency_hz in heard)


def test_milling_chatter_is_one_event(replayed):
    """At 10 s its line drops out for a moment, but the cut is not as it was; it has its frequency and no damping."""
    (event,) = replayed("ubc_milling_chatter.flac").of("event")
    assert 1060 <= event["peak_frequency_hz"] <= 1080
    assert event["min_damping_ratio"] < 0.002


def test_forced_milling_is_forced_once_its_comb_is_known(replayed):
    """At an unknown speed: never an alarm, and forced from 4 s on until the cut ends at 8.8 s."""
    outcome = replayed("ubc_milling_no_chatter.flac")
    assert outcome.alarms() == []
    cutting = [verdict["state"] for verdict in outcome.of("verdict") if 4.0 <= verdict["t0"] < 8.8]
    assert set(cutting) == {"forced"}


def test_the_comb_of_forced_milling_is_found():
    """Within the first four seconds and until the end the comb reads 91.6 Hz within 0.5 Hz."""
    samples, rate = soundfile.read(path_of("ubc_milling_no_chatter.flac"))
    samples = soxr.resample(samples, rate, RATE_HZ)
    settings = load([])
    channel = Channel(settings.tracker, settings.orders, settings.spindle, source_rate_hz=rate)
    found = [(o.odp.first_sample / RATE_HZ, o.orders.rotation_hz) for o in channel.process(0, samples)]
    known = np.array([hertz for t, hertz in found if t >= 4.0], float)
    np.testing.assert_allclose(known, 91.6, atol=0.5)


@pytest.mark.parametrize("name", ["turning_s_320_030_10k.wav", "turning_s_320_040_10k.wav"])
def test_stable_turning_does_not_alarm(replayed, name):
    """Stable cuts almost as loud as chatter raise no alarm."""
    assert replayed(name).alarms() == []


def test_accelerometer_chatter_is_found(replayed):
    """The burst, labelled 684 Hz and 4 to 5 s, raises the alarm as it grows, and the steady comb of 150 Hz none.

    Its line slides from 749 Hz, where it leaves the noise at 3.5 s, to 707 Hz at 4 s, and grows tenfold meanwhile.
    """
    alarms = replayed("ubc_milling_accelerometer_5k.wav").alarms()
    assert 3.6 <= alarms[0]["t0"] <= 4.4
    assert all(680 <= alarm["frequency_hz"] <= 745 for alarm in alarms if alarm["frequency_hz"] is not None)
    assert all(alarm["t1"] <= 6.0 for alarm in alarms)


def test_accelerometer_alarm_ends_with_the_burst(replayed):
    """The alarm of the accelerometer recording ends when the burst does, at 4.9 s, and does not come back."""
    alarms = replayed("ubc_milling_accelerometer_5k.wav").alarms()
    assert 4.8 <= alarms[-1]["t1"] <= 5.05


def test_turning_chatter_is_found(replayed):
    """The excerpt of chattering turning, which grows for half of its second, is an alarm from then on."""
    alarms = replayed("turning_c_770_005_10k.wav").alarms()
    assert alarms[0]["t0"] <= 0.5
    assert alarms[-1]["t1"] == 1.0
    assert all(1050 <= alarm["frequency_hz"] <= 1350 for alarm in alarms if alarm["frequency_hz"] is not None)


@pytest.mark.parametrize("skipped", [100, 250, 350])
def test_turning_chatter_is_found_wherever_the_frames_begin(tmp_path, skipped):
    """The same cut, heard from 10, 25 or 35 ms later on."""
    samples, rate = soundfile.read(path_of("turning_c_770_005_10k.wav"))
    soundfile.write(tmp_path / "later.wav", samples[skipped:], rate)
    assert replay(tmp_path / "later.wav", tmp_path).alarms()


@pytest.mark.parametrize("altered", CLOTHES)
def test_turning_chatter_is_found_in_other_clothes(altered):
    """Another machine at another speed, as far as one recording can stand for it, and a louder room."""
    chatters = next(each for each in RECORDINGS if each.name.startswith("turning_c"))
    samples, rate = soundfile.read(path_of(chatters.name))
    assert told(chatters, altered, samples, rate).alarm_s > 0.25


@pytest.mark.parametrize("altered", CLOTHES)
@pytest.mark.parametrize("recording", [each for each in RECORDINGS if each.chatter_s is None])
def test_what_does_not_chatter_does_not_in_other_clothes(recording, altered):
    """Nor is it an alarm when it is another machine's."""
    samples, rate = soundfile.read(path_of(recording.name))
    assert told(recording, altered, samples, rate).false_s == 0.0
