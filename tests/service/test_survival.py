"""What a recording may do to the main job without harm."""

from __future__ import annotations

import numpy as np
import pytest
import soundfile
import soxr

from tests.replaying import REPLAY_DATA, replay
from tests.signals import RATE_HZ, vibration

RATE = int(RATE_HZ)


@pytest.fixture(scope="module")
def bar():
    """The recording of the bar that chatters in its middle."""
    return soundfile.read(REPLAY_DATA / "bar_turning.flac")[0]


@pytest.fixture(scope="module")
def reference(bar, tmp_path_factory):
    """What is said about it as it is, in floating point."""
    directory = tmp_path_factory.mktemp("reference")
    soundfile.write(directory / "bar.wav", bar, RATE, subtype="FLOAT")
    return replay(directory / "bar.wav", directory)


@pytest.fixture
def replay_samples(tmp_path):
    """Replay samples as a file."""

    def run(samples, rate=RATE, subtype="FLOAT", **tables):
        path = tmp_path / "samples.wav"
        soundfile.write(path, samples, rate, subtype=subtype)
        return replay(path, tmp_path, **tables)

    return run


def chatter_of(outcome, channel=0):
    """Onset, end and frequency of the only event of a channel."""
    (event,) = outcome.of("event", channel)
    return event["onset_s"], event["end_s"], event["peak_frequency_hz"]


@pytest.mark.slow
def test_an_hour_of_digital_silence(tmp_path):
    """An hour of zeros is idle from end to end, and is replayed within the time limit of a test."""
    path = tmp_path / "silence.flac"
    minute = np.zeros(60 * RATE)
    with soundfile.SoundFile(path, "w", RATE, 1) as file:
        for _ in range(60):
            file.write(minute)
    outcome = replay(path, tmp_path)
    assert outcome.summary["seconds_in"] == [{"idle": pytest.approx(3600.0)}]
    assert len(outcome.states()) == 3600 * 20
    last = outcome.of("health")[-1]
    assert (last["t"], last["samples_in"], last["lost"]) == (3600.0, 3600 * RATE, 0)


def test_silence_in_between_leaves_the_tracker_as_it_was(replay_samples, bar):
    """After 20 s of zeros in the middle of chatter, the next half second is heard as chatter again."""
    cut = 9 * RATE
    outcome = replay_samples(np.concatenate([bar[:cut], np.zeros(20 * RATE), bar[cut : cut + RATE]]))
    states = outcome.states()
    assert set(states[190:570]) == {"idle"}
    assert set(states[590:600]) == {"self_excited"}
    assert [event["end_s"] < 9.5 for event in outcome.of("event")] == [True, False]


@pytest.mark.parametrize("level", [0.5, -1e-4, 20.0])
def test_constant_input(replay_samples, level):
    """A channel that is stuck is no cut: after its start it is idle, and nothing is claimed about a mode."""
    outcome = replay_samples(np.full(10 * RATE, level))
    assert outcome.states()[0] == "unknown"
    assert set(outcome.states()[3:]) == {"idle"}
    assert all(verdict["damping_ratio"] is None for verdict in outcome.of("verdict")[3:])


@pytest.mark.parametrize("gain", [1e-6, 1e6])
def test_the_scale_does_not_matter(replay_samples, bar, reference, gain):
    """A million times smaller or larger, every state is the same."""
    scaled = replay_samples(gain * bar)
    assert scaled.states() == reference.states()
    assert scaled.summary["samples_clipped"] == 0


@pytest.mark.parametrize("gain", [2.0**-20, 2.0**20])
def test_the_scale_does_not_matter_to_the_damping(replay_samples, bar, reference, gain):
    """Where the gain changes no bit of a mantissa, damping is the same to 1e-4.

    Other gains round every sample anew. The recursion of the lowest octave, 128 samples of memory for 7 coefficients,
    may then settle on other modes where nothing stands out (decision 11).
    """
    damping, expected = (
        np.array([verdict["damping_ratio"] for verdict in outcome.of("verdict")], dtype=float)
        for outcome in (replay_samples(gain * bar), reference)
    )
    np.testing.assert_allclose(damping, expected, atol=1e-4)
    assert np.isfinite(expected).sum() > 300


def test_samples_that_are_no_numbers(replay_samples, bar, reference):
    """NaN and infinity make the intervals that they touch unknown, are counted, and leave the rest as it is."""
    bad = bar.copy()
    bad[10 * RATE : 10 * RATE + 10] = np.nan
    bad[11 * RATE + 1000] = np.inf
    bad[12 * RATE] = -np.inf
    outcome = replay_samples(bad)
    states, expected = outcome.states(), reference.states()
    touched = {200, 221, 240}  # 640 samples each
    assert {i for i, state in enumerate(states) if state == "unknown"} == {0} | touched
    moved = [i for i, pair in enumerate(zip(states, expected, strict=True)) if i not in touched and len({*pair}) > 1]
    assert len(moved) <= 1  # the end of the alarm, by one interval: the recursion took another way there
    assert outcome.summary["samples_non_finite"] == 12
    assert outcome.of("verdict")[200]["flags"] == ["non_finite"]
    assert chatter_of(outcome) == pytest.approx(chatter_of(reference), abs=0.06)


def test_nothing_but_nan(replay_samples):
    """A recording without a single number is unknown throughout, never stable."""
    outcome = replay_samples(np.full(2 * RATE, np.nan))
    assert set(outcome.states()) == {"unknown"}
    assert outcome.summary["samples_non_finite"] == 2 * RATE


def test_a_file_cut_off_in_mid_frame(tmp_path, bar):
    """What is left is replayed to the last whole sample, and the summary says how many are missing."""
    path = tmp_path / "cut.wav"
    soundfile.write(path, np.stack([bar, bar], axis=1), RATE, subtype="PCM_24")
    kept = 12 * RATE + 77
    whole = path.read_bytes()
    header = len(whole) - 6 * len(bar)
    path.write_bytes(whole[: header + 6 * kept + 4])  # a sample of the first channel, and a byte of the other's
    outcome = replay(path, tmp_path)
    assert outcome.summary["samples_missing"] == len(bar) - kept
    assert [outcome.of("verdict", channel)[-1]["sample1"] for channel in (0, 1)] == [kept, kept]
    assert outcome.summary["duration_s"] == pytest.approx(kept / RATE)


@pytest.mark.parametrize(
    ("rate", "channels", "subtype"),
    [
        (192_000, 1, "PCM_24"),
        (8_000, 1, "PCM_16"),
        (48_000, 8, "PCM_24"),
        (44_100, 2, "FLOAT"),
        (11_025, 1, "DOUBLE"),
        (12_800, 1, "PCM_32"),
    ],
)
def test_any_rate_format_and_channel_count(replay_samples, bar, reference, rate, channels, subtype):
    """The chatter is where it is and has its frequency, in every channel, and no sample lies in no verdict."""
    samples = soxr.resample(bar, RATE, rate, quality="VHQ") if rate != RATE else bar
    outcome = replay_samples(np.stack([samples] * channels, axis=1), rate, subtype)
    assert outcome.summary["channels"] == channels
    onset, end, frequency = chatter_of(reference)
    for channel in range(channels):
        assert chatter_of(outcome, channel) == (
            pytest.approx(onset, abs=0.75),
            pytest.approx(end, abs=0.5),
            pytest.approx(frequency, rel=0.01),
        )
        assert outcome.of("verdict", channel)[-1]["sample1"] == pytest.approx(len(bar), abs=1)
        assert outcome.states(channel).count("unknown") <= 2


def test_channels_are_apart(replay_samples, bar):
    """One channel chatters, one is silent, one is broken: each is told by itself."""
    quiet = 0.01 * vibration(len(bar), [(400, 0.03)])
    broken = np.full(len(bar), np.nan)
    outcome = replay_samples(np.stack([np.zeros(len(bar)), bar, quiet, broken], axis=1))
    assert set(outcome.states(0)) == {"idle"}
    assert 7 < len(outcome.alarms(1)) / 20 < 9
    heard = outcome.states(2)[1:]
    assert set(heard) <= {"stable", "forced"}
    assert np.mean([state == "stable" for state in heard]) > 0.9  # by chance noise looks steady now and then
    assert set(outcome.states(3)) == {"unknown"}
    assert [event["channel"] for event in outcome.of("event")] == [1]


def test_a_single_sample(replay_samples):
    """A recording of one sample has one verdict, of one sample."""
    outcome = replay_samples(np.array([0.1]))
    (verdict,) = outcome.of("verdict")
    assert (verdict["sample0"], verdict["sample1"]) == (0, 1)
    assert verdict["state"] == "unknown"


def test_clipping_is_counted_and_still_heard(replay_samples, bar):
    """A recording at 20 dB too much gain tells of its clipping, and chatters where it does."""
    clipped = np.clip(10 * bar, -1, 1)
    outcome = replay_samples(clipped, subtype="PCM_16")
    assert outcome.summary["samples_clipped"] > 1000
    assert any("clipped" in verdict["flags"] for verdict in outcome.of("verdict"))
    onset, _, frequency = chatter_of(outcome)
    assert onset == pytest.approx(7.0, abs=1.0)
    assert frequency == pytest.approx(327, abs=3)
