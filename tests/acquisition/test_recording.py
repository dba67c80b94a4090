"""Recordings on disk, whole and broken."""

from __future__ import annotations

import resource
import tracemalloc

import numpy as np
import pytest
import soundfile
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.acquisition.resample import Resampled
from chatter_monitor.errors import InputError
from chatter_monitor.records import Flag


def noise(samples, channels, seed=0):
    return np.random.default_rng(seed).uniform(-0.5, 0.5, (samples, channels))


@pytest.mark.parametrize(
    ("name", "subtype", "rate", "channels", "step"),
    [
        ("x.wav", "PCM_U8", 8000, 1, 2.0**-7),
        ("x.wav", "PCM_16", 192_000, 2, 2.0**-15),
        ("x.wav", "PCM_24", 44_100, 8, 2.0**-23),
        ("x.wav", "PCM_32", 51_200, 3, 2.0**-31),
        ("x.wav", "FLOAT", 48_000, 2, 2.0**-24),
        ("x.wav", "DOUBLE", 11_025, 1, 0.0),
        ("x.flac", "PCM_16", 192_000, 8, 2.0**-15),
        ("x.flac", "PCM_24", 8000, 1, 2.0**-23),
    ],
)
def test_any_rate_format_and_channel_count_is_read(tmp_path, hear, name, subtype, rate, channels, step):
    """What was written comes back within the format's step, at the file's own rate, with nothing flagged."""
    written = noise(10_000, channels)
    soundfile.write(tmp_path / name, written, rate, subtype=subtype)
    with Recording(tmp_path / name, block_samples=999) as source:
        assert (source.sample_rate_hz, source.channels, source.length) == (float(rate), channels, 10_000)
        heard = hear(source)
        assert (source.missing_samples, source.clipped_samples, source.non_finite_samples) == (0, 0, 0)
    assert np.abs(heard.samples - written).max() <= step
    assert not heard.flags.any()


def test_channels_are_selected_and_scaled(tmp_path, hear):
    """Channels come in the order that was asked for, in units of the sensor."""
    written = noise(5000, 4)
    soundfile.write(tmp_path / "x.wav", written, 48_000, subtype="DOUBLE")
    with Recording(tmp_path / "x.wav", channels=[2, 0], full_scale_per_unit=0.01) as source:
        assert source.channels == 2
        assert np.array_equal(hear(source).samples, written[:, [2, 0]] / 0.01)


@pytest.mark.parametrize("channels", [[2], [0, -1]])
def test_an_absent_channel_is_refused(tmp_path, channels):
    """A channel that the file lacks is named, with those that it has."""
    soundfile.write(tmp_path / "x.wav", noise(100, 2), 48_000)
    with pytest.raises(InputError, match="allowed: 0 to 1"):
        Recording(tmp_path / "x.wav", channels=channels)


@pytest.fixture(scope="module")
def faulty(tmp_path_factory):
    """A float file with stretches of NaN, Inf and clipping, some of them adjacent."""
    samples = noise(6000, 2, seed=7)
    samples[300, 0] = np.nan
    samples[1000:1003, 1] = np.inf
    samples[3000:3010, 0] = 1.0
    samples[3005, 1] = -np.inf
    samples[5999, 1] = np.nan
    path = tmp_path_factory.mktemp("faulty") / "x.wav"
    soundfile.write(path, samples, 48_000, subtype="FLOAT")
    return path


@settings(max_examples=20, derandomize=True, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(block_samples=st.integers(7, 2000))
def test_block_size_changes_neither_samples_nor_flags(faulty, hear, block_samples):
    """Every sample and its flags are the same for any block size, at the file's rate and at the tracker's."""
    with Recording(faulty, block_samples=block_samples) as source, Recording(faulty) as reference:
        heard, expected = hear(source), hear(reference)
    assert np.array_equal(heard.samples, expected.samples)
    assert np.array_equal(heard.flags, expected.flags)
    assert (source.clipped_samples, source.non_finite_samples) == (10, 6)
    with Recording(faulty, block_samples=block_samples) as source, Recording(faulty) as reference:
        heard, expected = hear(Resampled(source)), hear(Resampled(reference))
    assert np.array_equal(heard.samples, expected.samples)
    assert np.array_equal(heard.flags, expected.flags)


def test_faults_are_flagged_on_their_channel(faulty, hear):
    """Samples that are not finite read 0, and each fault lies under its flag, on its channel only."""
    with Recording(faulty) as source:
        heard = hear(source)
    assert np.isfinite(heard.samples).all()
    assert heard.samples[300, 0] == 0.0
    assert heard.flags[299].tolist() == [0, 0]
    assert heard.flags[300].tolist() == [Flag.NON_FINITE, 0]
    assert heard.flags[1002].tolist() == [0, Flag.NON_FINITE]
    assert heard.flags[3009].tolist() == [Flag.CLIPPED, Flag.NON_FINITE]
    assert heard.flags[5000].tolist() == [0, 0]
    assert heard.flags[5999].tolist() == [0, Flag.NON_FINITE]


@pytest.mark.parametrize("subtype", ["PCM_U8", "PCM_16", "PCM_24", "PCM_32", "FLOAT"])
def test_a_crest_cut_off_at_full_scale_is_clipped(tmp_path, hear, subtype):
    """Three samples at the format's extreme code are clipping, two are not."""
    samples = noise(2000, 1)
    samples[100:102] = 1.0
    samples[1000:1003] = -1.0
    samples[1500:1504] = 1.0
    soundfile.write(tmp_path / "x.wav", samples, 48_000, subtype=subtype)
    with Recording(tmp_path / "x.wav") as source:
        heard = hear(source)
    assert source.clipped_samples == 7
    assert heard.flags[[102, 999, 1002, 1503], 0].tolist() == [0, 0, Flag.CLIPPED, Flag.CLIPPED]


def test_24_bits_in_a_32_bit_file_clip_too(tmp_path, hear):
    """The largest code of a 24-bit converter counts as full scale in a 32-bit file."""
    codes = np.zeros((1000, 1), dtype=np.int32)
    codes[500:505] = 0x7FFFFF00
    soundfile.write(tmp_path / "x.wav", codes, 48_000, subtype="PCM_32")
    with Recording(tmp_path / "x.wav") as source:
        hear(source)
    assert source.clipped_samples == 5


def test_physical_units_do_not_clip(tmp_path, hear):
    """A floating-point file in m/s² far above 1 has no full scale, and its values come back as they are."""
    samples = np.repeat(40.0 * noise(500, 1), 4, axis=0)
    soundfile.write(tmp_path / "x.wav", samples, 25_600, subtype="DOUBLE")
    with Recording(tmp_path / "x.wav") as source:
        heard = hear(source)
    assert np.array_equal(heard.samples, samples)
    assert source.clipped_samples == 0


@pytest.mark.parametrize(
    ("subtype", "kept_bytes"), [("PCM_16", 40_001), ("PCM_24", 60_001), ("FLOAT", 60_003), ("PCM_U8", 12_345)]
)
def test_a_wav_cut_off_in_mid_frame_reports_what_is_missing(tmp_path, hear, subtype, kept_bytes):
    """All whole samples are read, and those that the header promised beyond them are counted, from the start on."""
    path = tmp_path / "x.wav"
    soundfile.write(path, noise(20_000, 2), 48_000, subtype=subtype)
    with Recording(path) as source:
        whole = hear(source).samples
    path.write_bytes(path.read_bytes()[:kept_bytes])
    with Recording(path) as source:
        assert source.missing_samples == 20_000 - source.length
        heard = hear(source)
        assert source.missing_samples == 20_000 - len(heard.samples)
    assert 0 < len(heard.samples) < 20_000
    assert np.array_equal(heard.samples, whole[: len(heard.samples)])


@pytest.mark.parametrize("container", ["RF64", "AIFF"])
def test_other_containers_report_what_is_missing_too(tmp_path, hear, container):
    """A cut off RF64 (WAV above 4 GB) or AIFF counts its missing samples."""
    path = tmp_path / "x"
    soundfile.write(path, noise(20_000, 2), 48_000, format=container, subtype="PCM_16")
    path.write_bytes(path.read_bytes()[:40_001])
    with Recording(path) as source:
        assert len(hear(source).samples) + source.missing_samples == 20_000
        assert source.missing_samples > 0


@pytest.mark.parametrize("size", [0, 0x7FFFFFFF, 0xFFFFFFFF])
def test_a_wav_from_a_pipe_misses_nothing(tmp_path, hear, size):
    """A header that could not know the size, or was never completed, is no loss."""
    path = tmp_path / "x.wav"
    soundfile.write(path, noise(20_000, 2), 48_000, subtype="PCM_16")
    content = bytearray(path.read_bytes())
    content[4:8] = (8 if size == 0 else min(size + 36, 0xFFFFFFFF)).to_bytes(4, "little")
    content[40:44] = size.to_bytes(4, "little")
    path.write_bytes(content)
    with Recording(path) as source:
        assert len(hear(source).samples) == 20_000
        assert source.missing_samples == 0


@pytest.mark.parametrize("block_samples", [1000, 4096, 50_000])
@pytest.mark.parametrize("damage", ["cut off", "overwritten"])
def test_a_damaged_flac_is_read_up_to_the_damage(tmp_path, hear, damage, block_samples):
    """Everything before the damage comes back, whatever the block size, and the rest is counted as missing."""
    path = tmp_path / "x.flac"
    soundfile.write(path, noise(20_000, 2), 48_000)
    whole, _ = soundfile.read(path)
    content = path.read_bytes()
    half = len(content) // 2
    path.write_bytes(content[:half] if damage == "cut off" else content[:half] + bytes(200) + content[half + 200 :])
    with Recording(path, block_samples=block_samples) as source:
        heard = hear(source)
    assert 4096 <= len(heard.samples) < 16_000
    assert np.array_equal(heard.samples, whole[: len(heard.samples)])
    assert source.missing_samples == 20_000 - len(heard.samples)


def test_a_flac_from_a_pipe_is_read_to_its_end(tmp_path, hear):
    """A FLAC stream that does not know its length is read whole, and misses nothing."""
    path = tmp_path / "x.flac"
    soundfile.write(path, noise(20_000, 1), 48_000)
    content = bytearray(path.read_bytes())
    content[21] &= 0xF0  # the 36 bits of STREAMINFO's number of samples
    content[22:26] = bytes(4)
    path.write_bytes(content)
    with Recording(path) as source:
        assert source.length is None
        assert len(hear(source).samples) == 20_000
        assert source.missing_samples == 0


def broken(tmp_path, kind):
    path = tmp_path / "x.wav"
    if kind == "missing":
        return path
    if kind == "directory":
        path.mkdir()
        return path
    soundfile.write(path, noise(1000, 2), 48_000, subtype="PCM_16")
    header = path.read_bytes()[:44]
    soundfile.write(tmp_path / "x.flac", noise(20_000, 1), 48_000)
    content = {
        "zero-length": b"",
        "text": b"The operator wrote this by hand.\n" * 50,
        "header only": header,
        "half a header": header[:20],
        "header without data": header[:36],
        "rate of zero": header[:24] + bytes(4) + header[28:] + bytes(4000),
        "FLAC header only": (tmp_path / "x.flac").read_bytes()[:60],
    }[kind]
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("missing", "cannot be opened: No such file"),
        ("directory", "cannot be opened: Is a directory"),
        ("zero-length", "holds no samples"),
        ("text", "not a sound file"),
        ("header only", "holds no samples"),
        ("half a header", "not a sound file"),
        ("header without data", "not a sound file"),
        ("rate of zero", "not a sound file"),
        ("FLAC header only", "not a sound file"),
    ],
)
def test_what_cannot_be_read_is_the_users_to_mend(tmp_path, kind, words):
    """Each broken input ends in one line that says what is wrong, with what, and what would do."""
    path = broken(tmp_path, kind)
    with pytest.raises(InputError, match=words) as caught:
        list(Recording(path).blocks())
    assert caught.value.exit_code == 2
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    assert caught.value.remedy


def test_a_big_file_does_not_fill_the_memory(tmp_path):
    """Reading and converting 200 MB takes a few blocks of memory."""
    path = tmp_path / "x.wav"
    soundfile.write(path, np.zeros((0, 8)), 48_000, subtype="DOUBLE", format="RF64")
    header = bytearray(path.read_bytes())
    samples = 3_200_000
    data = header.rindex(b"data")
    ds64 = header.index(b"ds64")
    header[ds64 + 16 : ds64 + 24] = (samples * 64).to_bytes(8, "little")
    header[ds64 + 24 : ds64 + 32] = samples.to_bytes(8, "little")
    with path.open("wb") as file:
        file.write(header[: data + 8])
        file.truncate(data + 8 + samples * 64)
    before_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    tracemalloc.start()
    try:
        with Recording(path) as source:
            assert source.length == samples
            heard = sum(len(block.samples) for block in Resampled(source).blocks())
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    grown_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before_kb
    assert heard == round(samples * 12_800 / 48_000)
    assert peak_bytes < 10e6
    assert grown_kb < 50e3
