"""Machine configurations."""

from __future__ import annotations

from dataclasses import replace

import msgspec
import pytest

from chatter_monitor.config import Settings, load
from chatter_monitor.errors import InputError

# every key that the design promises to machine configurations
CONTRACT = """
[machine]
name = "lathe-3"
[input]
device = "default"
channels = [0]
sample_rate_hz = 48000
sensor = "microphone"
full_scale_per_unit = 1.0
[spindle]
speed_rpm = 1656.0
teeth = 6
[tracker]
orders = [4, 3]
memory_ms = 80
sample_rate_hz = 12800
[verdict]
[publish]
bind = "tcp://127.0.0.1:5557"
[recorder]
directory = "/var/lib/chatter-monitor"
pre_s = 5
post_s = 5
quota_gb = 5
"""


@pytest.fixture
def write(tmp_path):
    """Write a configuration file."""

    def write(text, name="machine.toml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def test_every_key_of_the_contract_is_accepted(write):
    """The design's configuration is taken, and what it writes out are the defaults but for name and spindle."""
    settings = load([write(CONTRACT)])
    assert settings.machine.name == "lathe-3"
    assert (settings.spindle.speed_rpm, settings.spindle.teeth) == (1656.0, 6)
    assert settings.input.channels == (0,)
    default = Settings()
    for table in ("tracker", "verdict", "publish", "recorder"):
        assert getattr(settings, table) == getattr(default, table)
    assert msgspec.structs.replace(settings.input, channels=None, sample_rate_hz=None) == default.input


def test_values_arrive(write):
    """What is written is what the settings hold, in every table."""
    path = write(
        '[input]\ndevice = "hw:1"\nsample_rate_hz = 96000\nsensor = "accelerometer"\n'
        "[tracker]\norders = [6, 4]\nhigh_pass_hz = 5\n[verdict]\nalarm_probability = 0.7\n"
        '[publish]\nbind = "tcp://127.0.0.1:6000"\nhigh_water_mark = 9\n[recorder]\nquota_gb = 1.5\npre_s = 0\n'
    )
    settings = load([path])
    assert settings.input.device == "hw:1"
    assert settings.input.sample_rate_hz == 96_000
    assert settings.input.sensor == "accelerometer"
    assert settings.tracker.orders == (6, 4)
    assert settings.tracker.high_pass_hz == 5
    assert settings.verdict.alarm_probability == 0.7
    assert settings.publish == replace(Settings().publish, bind="tcp://127.0.0.1:6000", high_water_mark=9)
    assert (settings.recorder.quota_gb, settings.recorder.pre_s) == (1.5, 0)


def test_without_files_everything_has_its_default():
    """No file, or an empty one, is a valid configuration."""
    assert load([]) == Settings()


def test_the_later_file_wins_key_by_key(write):
    """A later file changes the keys that it has and leaves the others; options win over all files."""
    first = write('[spindle]\nspeed_rpm = 1000.0\nteeth = 2\n[machine]\nname = "a"\n', "a.toml")
    second = write("[spindle]\nspeed_rpm = 2000.0\n", "b.toml")
    spindle = load([first, second]).spindle
    assert (spindle.speed_rpm, spindle.teeth) == (2000.0, 2)
    assert load([second, first]).spindle.speed_rpm == 1000.0
    assert load([first, second]).machine.name == "a"
    assert load([first, second], {"spindle": {"teeth": 3}}).spindle.teeth == 3


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (
            "[tracker]\nmemory = 80\n",
            ["unknown key [tracker] memory", "orders, memory_ms", "Did you mean 'memory_ms'?"],
        ),
        ("[trackers]\n", ["unknown key [trackers]", "machine, input", "Did you mean 'tracker'?"]),
        ("[publish]\nbnd = 1\n", ["unknown key [publish] bnd", "Did you mean 'bind'?"]),
        ("[recorder]\nqqq = 1\n", ["unknown key [recorder] qqq", "directory, pre_s, post_s, quota_gb"]),
        ("name = 3\n", ["unknown key [name]"]),
    ],
)
def test_an_unknown_key_is_refused(write, text, parts):
    """The message names the file, the key, those that are known and the nearest of them."""
    with pytest.raises(InputError) as caught:
        load([write(text)])
    for part in ["machine.toml", *parts]:
        assert part in str(caught.value)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ('[tracker]\nmemory_ms = "long"\n', ["[tracker] memory_ms", "got 'long'", "Expected `float`"]),
        ("[tracker]\norders = [3, 3]\n", ["[tracker]", "orders must be [2, 4, 6 or 8, 0 to 6], got [3, 3]"]),
        ("[tracker]\nmemory_ms = inf\n", ["[tracker] memory_ms", "got inf", "a finite number"]),
        ("[spindle]\nspeed_rpm = nan\n", ["[spindle] speed_rpm", "got nan", "a finite number"]),
        ("[spindle]\nteeth = 0\n", ["[spindle] teeth", "got 0", ">= 1"]),
        ("[verdict]\ncertainty = 1.0\n", ["[verdict] certainty", "got 1.0", "< 1.0"]),
        (
            "[verdict]\nalarm_probability = 0.4\n",
            ["[verdict]", "calm_probability must not be above alarm_probability (0.4), got 0.5"],
        ),
        ("[input]\nchannels = [0, -1]\n", ["[input] channels[1]", "got [0, -1]", ">= 0"]),
        ('[input]\nsensor = "ear"\n', ["[input] sensor", "got 'ear'"]),
        ("[input]\nsample_rate_hz = 0\n", ["[input] sample_rate_hz", "got 0", "> 0"]),
        ('[machine]\nname = ""\n', ["[machine] name", "got ''", "length >= 1"]),
        ("[recorder]\nquota_gb = 0\n", ["[recorder] quota_gb", "got 0", "> 0"]),
        ("[recorder]\npre_s = -1\n", ["[recorder] pre_s", "got -1", ">= 0"]),
        ('[publish]\nbind = "tcp://0.0.0.0:5557"\n', ["network is refused", "tcp://0.0.0.0:5557", "CURVE"]),
        ("[publish]\nhigh_water_mark = 0\n", ["high-water mark", "got 0", ">= 1"]),
        ("machine = 3\n", ["'machine'", "is a table", "got 3"]),
        ("[[tracker]]\n", ["'tracker'", "is a table"]),
        ("[machine.name]\nx = 1\n", ["[machine] name", "Expected `str`"]),
        ("[tracker\n", ["is not TOML"]),
    ],
)
def test_a_value_that_is_not_allowed_is_refused(write, text, parts):
    """The message names the file, the key, the value and what is allowed instead."""
    with pytest.raises(InputError) as caught:
        load([write(text)])
    for part in ["machine.toml", *parts]:
        assert part in str(caught.value)


def test_an_override_is_checked_like_a_file():
    """A value from the command line is refused with the table and key that it stands for."""
    with pytest.raises(InputError, match=r"\[spindle\] speed_rpm in the settings .* got -1"):
        load([], {"spindle": {"speed_rpm": -1.0}})


@pytest.mark.parametrize("name", ["absent.toml", "."])
def test_a_file_that_cannot_be_read(tmp_path, name):
    """A path that is no readable file is named."""
    with pytest.raises(InputError, match="cannot be read") as caught:
        load([tmp_path / name])
    assert str(tmp_path) in str(caught.value)


def test_a_file_that_is_not_text(tmp_path):
    """A file in another encoding than UTF-8 is not TOML."""
    path = tmp_path / "machine.toml"
    path.write_bytes(b'[machine]\nname = "\xff"\n')
    with pytest.raises(InputError, match="not TOML"):
        load([path])
