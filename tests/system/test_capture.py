"""The daemon with a real sound server: what it hears, and what it does when it does not hear."""

from __future__ import annotations

import json
import logging
import subprocess
import sys
import tempfile
import time
from itertools import pairwise
from pathlib import Path

import msgspec
import numpy as np
import pyarrow.compute as pc
import pyarrow.parquet as pq
import pytest
import soundfile

from chatter_monitor.outlets.wire import encode
from chatter_monitor.records import Health
from tests.replaying import REPLAY_DATA, parse, replay
from tests.signals import vibration
from tests.system.components import need
from tests.system.running import Running, deaf, hears, known, silent, unknown
from tests.system.sound_server import SoundServer

RATE_HZ = 12_800
INTERVAL = 640

LOG = logging.getLogger(__name__)  # the times: pytest --log-cli-level=INFO

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]


@pytest.fixture
def server():
    """A sound server whose card runs at the tracker's rate."""
    need(pulseaudio="pulseaudio", pactl="pulseaudio-utils", paplay="pulseaudio-utils")
    with tempfile.TemporaryDirectory(prefix="cm-") as directory, SoundServer(Path(directory), RATE_HZ) as server:
        yield server


@pytest.fixture
def monitor(server):
    """A daemon that hears the server's card, and has begun to."""
    with (
        tempfile.TemporaryDirectory(prefix="cm-") as directory,
        Running(Path(directory), server.environment, "[input]\nchannels = [0, 1]\n") as monitor,
    ):
        monitor.until(hears)
        yield monitor


def played(directory, samples):
    """File of two channels that the card plays."""
    path = directory / "played.wav"
    soundfile.write(path, samples, RATE_HZ, subtype="FLOAT")
    return path


def test_the_daemon_hears_what_the_replay_reads(server, monitor, tmp_path):
    """Two recordings played into the card give the ODPs and verdicts of their replay, every sample and interval."""
    chatter, _ = soundfile.read(
        REPLAY_DATA / "bar_turning.flac", start=round(5.5 * RATE_HZ), stop=round(16.5 * RATE_HZ)
    )
    stable, _ = soundfile.read(REPLAY_DATA / "stable_turning.flac")
    samples = np.stack([chatter, np.resize(stable, len(chatter))], axis=1)
    player = server.play(played(tmp_path, samples))
    event = monitor.until(lambda taken: taken.message.topic == "event").message.body
    player.wait()
    last = monitor.until(silent, since_s=time.monotonic())
    assert monitor.stop() < 2.0

    # What the daemon heard stands in the recorded event, with its place on the daemon's index.
    about = msgspec.json.decode((monitor.events / event.id / f"{event.id}.json").read_bytes())
    heard, _ = soundfile.read(monitor.events / event.id / about["recording"])
    (place,) = np.flatnonzero((np.lib.stride_tricks.sliding_window_view(chatter, 64) == heard[:64, 0]).all(axis=1))
    assert np.array_equal(heard, samples[place : place + len(heard)])
    begin = about["first_sample"] - place
    end = begin + len(samples)

    # The same samples at the same place of the index, replayed.
    silence = last.message.header.sample0 - end
    around = np.pad(samples, ((begin, silence), (0, 0)))
    soundfile.write(tmp_path / "heard.wav", around, RATE_HZ, subtype="FLOAT")
    outcome = replay(tmp_path / "heard.wav", tmp_path, odp_table=tmp_path / "odp.parquet")
    table = pq.read_table(tmp_path / "odp.parquet")
    first = -(-begin // INTERVAL) * INTERVAL  # of the first interval that is all sound
    frames = {(frame.channel, frame.first_sample): frame for frame in monitor.frames()}
    for channel in (0, 1):
        rows = table.filter(pc.field("channel") == channel)
        for sample in range(first, end - INTERVAL, INTERVAL):
            interval = rows.slice(sample, INTERVAL)
            assert interval["sample"][0].as_py() == sample
            for column in ("frequency_hz", "damping_ratio"):
                live = getattr(frames[channel, sample], column)
                replayed = [interval[f"{column}_{mode}"].to_numpy() for mode in range(live.shape[1])]
                assert np.array_equal(live, np.stack(replayed, axis=1), equal_nan=True), (channel, sample, column)
    live = [parse(encode(v).decode()) for v in monitor.verdicts() if first <= v.sample0 < end - INTERVAL]
    replayed = [v for v in outcome.of("verdict") if first <= v["sample0"] < end - INTERVAL]
    for channel in (0, 1):
        assert [v for v in live if v["channel"] == channel] == [v for v in replayed if v["channel"] == channel]
    assert {"stable", "approaching", "self_excited"} <= {v["state"] for v in live if v["channel"] == 0}
    (replayed_event,) = outcome.of("event")
    assert (event.onset_s, event.end_s) == (replayed_event["onset_s"], replayed_event["end_s"])


@pytest.mark.parametrize("how", ["frozen", "killed"])
def test_losing_the_sound_server(server, monitor, tmp_path, how):
    """Frozen for 5 s or killed: noticed within 1 s, unknown with the reason, heard again within 2 s, loss counted."""
    cut = 0.1 * vibration(60 * RATE_HZ, [(400, 0.03)])
    noise = played(tmp_path, np.stack([cut, cut], axis=1))
    server.play(noise)
    began = monitor.until(known)
    time.sleep(2.0)  # of undisturbed operation

    lost_s = time.monotonic()
    server.freeze() if how == "frozen" else server.kill()
    noticed = monitor.until(deaf, since_s=lost_s)
    first_unknown = monitor.until(unknown, since_s=lost_s)
    time.sleep(lost_s + 5.0 - time.monotonic())
    if how == "frozen":
        server.thaw()
    else:
        server.start()
        server.play(noise)
    back_s = time.monotonic()
    again = monitor.until(hears, since_s=back_s)
    claims = monitor.until(known, since_s=back_s)
    one_more = monitor.until(hears, since_s=claims.at_s)

    for name, taken, since_s in (
        ("noticed", noticed, lost_s),
        ("unknown", first_unknown, lost_s),
        ("hears again", again, back_s),
        ("claims again", claims, back_s),
    ):
        LOG.info("%s: %s after %.2f s", how, name, taken.at_s - since_s)
    assert noticed.at_s - lost_s < 1.0
    assert first_unknown.at_s - lost_s < 1.0
    assert again.at_s - back_s < 2.0
    assert claims.at_s - back_s < 2.0

    # Verdicts and health went on coming all the while, and said why.
    deaf_healths = [t for t in monitor.taken if isinstance(t.message.body, Health) and noticed.at_s <= t.at_s < back_s]
    assert len(deaf_healths) >= 4
    expected = "frozen" if how == "frozen" else "no sound device"
    assert all(t.message.body.state == "not_hearing" for t in deaf_healths)
    assert any(expected in reason for reason in deaf_healths[-1].message.body.reasons)
    verdicts = [verdict for verdict in monitor.verdicts() if verdict.channel == 0]
    assert all(one.sample1 == other.sample0 for one, other in pairwise(verdicts))
    quiet = [v for v in verdicts if noticed.message.body.t <= v.t0 and v.t1 <= deaf_healths[-1].message.body.t]
    assert len(quiet) >= 60
    assert {v.state for v in quiet} == {"unknown"}

    # Without a restart, and nothing missing in the account.
    assert {t.message.header.session for t in monitor.taken} == {began.message.header.session}
    before, after = deaf_healths[0].message.body, one_more.message.body
    lost = after.lost - before.lost
    away_s = again.at_s - lost_s
    assert abs(lost / RATE_HZ - (away_s - before_lost_s(before, monitor))) < 0.5
    assert monitor.stop() < 2.0


def before_lost_s(health, monitor):
    """Seconds of the loss at hand that a health message has counted already."""
    earlier = [
        t.message.body for t in monitor.taken if isinstance(t.message.body, Health) and t.message.body.t < health.t
    ]
    return (health.lost - earlier[-1].lost) / RATE_HZ


def command(server, *arguments):
    """Run a command to its end where the server's card is the default device."""
    return subprocess.run(
        [sys.executable, "-m", "chatter_monitor", *map(str, arguments)],
        env=server.environment,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def test_a_newcomer_is_told_what_can_be_heard(server, tmp_path):
    """`devices` lists the card, its rates, and what the configuration chooses; `doctor` tells silence from a tone."""
    config = tmp_path / "machine.toml"
    config.write_text(
        f'[publish]\nbind = "ipc://{tmp_path}/published"\n'
        f'[recorder]\ndirectory = "{tmp_path}/events"\nquota_gb = 0.01\n'
    )
    found = json.loads(command(server, "devices", "--json", "--config", config).stdout)
    (chosen,) = [device for device in found["devices"] if device["chosen"]]
    assert chosen["name"] == "default"
    assert chosen["sample_rates_hz"] == [12_800.0, 48_000.0, 51_200.0, 44_100.0]
    assert found["chosen_sample_rate_hz"] == 12_800.0

    silent = command(server, "doctor", "--config", config)
    assert silent.returncode == 3
    (wrong,) = [line for line in silent.stdout.splitlines() if line.startswith("WRONG")]
    assert "nothing changes on channel 0" in wrong
    tone = 0.1 * np.sin(np.arange(30 * RATE_HZ) * 0.2)
    server.play(played(tmp_path, np.stack([tone, tone], axis=1)))
    heard = command(server, "doctor", "--config", config)
    assert heard.returncode == 0, heard.stdout
    assert "'default' at 12.8 kHz hears -23 dBFS" in heard.stdout

    server.kill()
    gone = command(server, "devices", "--config", config)
    assert gone.returncode == 3
    assert gone.stdout.startswith("The configuration chooses none: there is no sound device")
