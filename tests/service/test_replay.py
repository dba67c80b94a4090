"""The main job from a file to everything that comes out."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import contextmanager
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import soundfile
import soxr

from chatter_monitor.config import load
from chatter_monitor.service import replay as service
from tests.replaying import REPLAY_DATA, parse, replay, truth_of
from tests.service.subscriber import ARRAYS
from tests.signals import RATE_HZ

RATE = int(RATE_HZ)
BAR = REPLAY_DATA / "bar_turning.flac"
MODES = 4


@pytest.fixture(scope="module")
def table_file(tmp_path_factory):
    return tmp_path_factory.mktemp("table") / "odp.parquet"


@pytest.fixture(scope="module")
def bar(tmp_path_factory, table_file):
    """Everything that is said about the bar that chatters in its middle."""
    return replay(BAR, tmp_path_factory.mktemp("bar"), odp_table=table_file)


def test_type_comes_first(bar, tmp_path):
    """Each line is a JSON object, without NaN, that begins with its type."""
    replay(BAR, tmp_path)
    lines = (tmp_path / "replayed.jsonl").read_text().splitlines()
    assert len(lines) == len(bar.messages)
    for line in lines:
        assert line.startswith('{"type":"')
        assert next(iter(parse(line))) == "type"


def test_every_sample_has_one_verdict(bar):
    """The verdicts of a channel follow each other without gap or overlap, from the first sample to the last."""
    verdicts = bar.of("verdict", 0)
    assert (verdicts[0]["sample0"], verdicts[-1]["sample1"]) == (0, 20 * RATE)
    for before, after in pairwise(verdicts):
        assert before["sample1"] == after["sample0"]
        assert before["t1"] == after["t0"]
    for verdict in verdicts:
        assert (verdict["t0"], verdict["t1"]) == (verdict["sample0"] / RATE, verdict["sample1"] / RATE)


def test_odps_come_20_times_a_second(bar, table_file):
    """Each interval has one ODP message before its verdict, with the values of its last sample in the table."""
    odps, verdicts = bar.of("odp", 0), bar.of("verdict", 0)
    assert len(odps) == len(verdicts) == 400
    assert [message["t"] for message in odps] == [(verdict["sample1"] - 1) / RATE for verdict in verdicts]
    kinds = [message["type"] for message in bar.messages if message["type"] in ("odp", "verdict")]
    assert kinds == ["odp", "verdict"] * 400
    table = pq.read_table(table_file)
    for m in range(MODES):
        frequency, damping, sd = (
            table[f"{name}_{m}"].to_numpy()[639::640] for name in ("frequency_hz", "damping_ratio", "damping_sd")
        )
        for i, message in enumerate(odps):
            mode = message["modes"][m]
            if mode["frequency_hz"] is None:
                assert np.isnan(frequency[i])
                continue
            assert (mode["frequency_hz"], mode["damping_ratio"]) == (frequency[i], damping[i])
            half = (mode["damping_ratio_ci95"][1] - mode["damping_ratio_ci95"][0]) / 2
            assert half == pytest.approx(1.96 * sd[i], rel=1e-5)
    assert sum(mode["frequency_hz"] is not None for message in odps for mode in message["modes"]) > 600


def test_the_table_has_every_sample(bar, table_file):
    """The table has a row for every sample of the recording, and verdicts on a mode are made of its medians."""
    table = pq.read_table(table_file)
    np.testing.assert_array_equal(table["sample"], np.arange(20 * RATE))
    for verdict in bar.of("verdict")[150:300]:
        rows = slice(verdict["sample0"], verdict["sample1"])
        middles = [np.median(table[f"damping_ratio_{m}"].to_numpy()[rows]) for m in range(MODES)]
        if verdict["damping_ratio_ci95"] is not None:  # else it is that of a line without a mode
            assert np.nanmin([abs(verdict["damping_ratio"] - middle) for middle in middles]) < 1e-4


def test_health_every_second(bar):
    """Health comes for every second and at the end; nothing was lost."""
    health = bar.of("health")
    assert [message["t"] for message in health] == [*map(float, range(1, 21)), 20.0]
    assert {message["state"] for message in health[:-1]} == {"hearing"}
    last = health[-1]
    assert last["state"] == "finished"
    assert (last["samples_in"], last["lost"], last["overflows"], last["publications_dropped"]) == (20 * RATE, 0, 0, 0)


def test_events_are_the_stretches_of_alarm(bar):
    """Each stretch of alarm is one event with its ends, told right after it."""
    stretches = [
        list(group) for state, group in groupby(bar.of("verdict"), lambda v: v["state"]) if state == "self_excited"
    ]
    events = bar.of("event")
    assert [(e["onset_s"], e["end_s"]) for e in events] == [(s[0]["t0"], s[-1]["t1"]) for s in stretches]
    assert len(events) == 1
    position = bar.messages.index(events[0])
    assert bar.messages[position - 1]["t0"] == events[0]["end_s"]
    assert bar.summary["events"] == events


def test_the_summary_adds_up(bar):
    """Seconds in each state add up to the duration, and are those of the verdicts."""
    (seconds,) = bar.summary["seconds_in"]
    assert sum(seconds.values()) == pytest.approx(bar.summary["duration_s"]) == 20.0
    for state, total in seconds.items():
        assert total == pytest.approx(0.05 * bar.states().count(state))


def test_chatter_is_told_while_the_bar_is_unstable(bar):
    """The alarm begins between the loss of stability and half a second into chatter, and ends with the chatter.

    It ends when the true damping is above the threshold of the judge, half a second allowed.
    """
    truth = truth_of("bar_turning")
    ((unstable, _),) = truth["unstable_s"]
    ((chatter, chatter_end),) = truth["chatter_s"]
    (event,) = bar.of("event")
    assert unstable <= event["onset_s"] <= chatter + 0.5
    threshold = load([]).verdict.approaching_damping
    recovered = next(i["t0"] for i in truth["intervals"] if i["t0"] > chatter_end and i["damping_ratio"] > threshold)
    assert chatter_end - 0.5 <= event["end_s"] <= recovered + 0.5


def test_chatter_is_told_at_its_frequency(bar):
    """In every interval of the alarm until the chatter has died down the frequency is the truth's within 1 %."""
    truth = truth_of("bar_turning")
    ((_, died_s),) = truth["chatter_s"]
    alarms = [verdict for verdict in bar.alarms() if verdict["t1"] <= died_s]
    assert len(alarms) > 100
    for verdict in alarms:
        frozen = truth["intervals"][round(verdict["t0"] / 0.05)]
        assert verdict["frequency_hz"] == pytest.approx(frozen["frequency_hz"], rel=0.01)


@pytest.mark.parametrize("name", ["stable_turning", "forced_milling"])
@pytest.mark.parametrize("known", [True, False])
def test_no_alarm_where_there_is_no_chatter(tmp_path, name, known):
    """Stable turning and forced milling raise no alarm, with the speed of the sidecar or without."""
    truth = truth_of(name)
    spindle = {"speed_rpm": truth["spindle_rpm"], "teeth": truth["teeth"]} if known else {}
    outcome = replay(REPLAY_DATA / f"{name}.flac", tmp_path, spindle=spindle)
    assert outcome.of("event") == []
    assert set(outcome.states()[1:]) <= {"stable", "forced", "approaching"}
    assert outcome.states().count("approaching") <= 0.05 * len(outcome.states())


def test_blocks_do_not_show(tmp_path, monkeypatch):
    """A recording at another rate, with faults, reads the same whatever the blocks that it is read in."""
    samples = soxr.resample(soundfile.read(BAR)[0][6 * RATE : 10 * RATE], RATE, 44_100)
    samples[[50_000, 90_000]] = np.nan
    samples[120_000:120_010] = 1.0
    soundfile.write(tmp_path / "cut.wav", samples, 44_100, subtype="FLOAT")
    outcomes = []
    for size in (32_768, 256, 1001):
        monkeypatch.setattr(service, "FAST_BLOCK_SAMPLES", size)
        outcomes.append(replay(tmp_path / "cut.wav", tmp_path, odp_table=tmp_path / f"{size}.parquet"))
    for kind in ("odp", "verdict", "event"):
        assert outcomes[0].of(kind) == outcomes[1].of(kind) == outcomes[2].of(kind)
    tables = [pq.read_table(tmp_path / f"{size}.parquet") for size in (32_768, 256, 1001)]
    for name in tables[0].column_names:
        bits = {table[name].to_numpy().tobytes() for table in tables}
        assert len(bits) == 1, name


# With other processes


def command(*arguments):
    return [sys.executable, "-m", "chatter_monitor", "replay", *map(str, arguments)]


@contextmanager
def subscriber(endpoint, report):
    """A subscriber in a process of its own; ended with the block."""
    process = subprocess.Popen([sys.executable, Path(__file__).with_name("subscriber.py"), endpoint, report])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


@pytest.fixture
def excerpt(tmp_path):
    """Three seconds around the onset of the bar's chatter, and less: the last frame is short."""
    path = tmp_path / "excerpt.wav"
    soundfile.write(path, soundfile.read(BAR)[0][5 * RATE : 8 * RATE - 100], RATE, subtype="PCM_16")
    return path


@pytest.fixture
def publishing(tmp_path):
    """Options and endpoint of a replay that publishes; the configuration may be given more keys."""

    def publishing(endpoint=None, **keys):
        if endpoint is None:
            with socket.create_server(("127.0.0.1", 0)) as server:
                endpoint = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        config = tmp_path / "machine.toml"
        lines = ["[publish]", f'bind = "{endpoint}"', *(f"{key} = {value}" for key, value in keys.items())]
        config.write_text("\n".join(lines))
        return endpoint, ["--config", config, "--publish", "--pace", "real"]

    return publishing


def test_a_subscriber_in_another_process_receives_everything(tmp_path, excerpt, publishing):
    """At the pace of life every message of every topic arrives, and the arrays are the table's, bit for bit."""
    endpoint, options = publishing()
    report, table_file, jsonl = (tmp_path / name for name in ("report.npz", "odp.parquet", "out.jsonl"))
    with subscriber(endpoint, report) as listening:
        outputs = ["--odp", table_file, "--jsonl", jsonl, "--wait-subscriber", 30]
        subprocess.run(command(excerpt, *options, *outputs), check=True, capture_output=True, timeout=200)
        assert listening.wait(30) == 0
    received = np.load(report)
    about = json.loads(str(received["about"]))
    assert (about["lost"], about["bad"]) == (0, 0)
    messages = [parse(line) for line in jsonl.read_text().splitlines()]
    count = {kind: sum(m["type"] == kind for m in messages) for kind in ("odp", "verdict", "event", "health")}
    assert count == {"odp": 60, "verdict": 60, "event": 1, "health": 3}
    seqs = {f"{kind}.0" if kind in ("odp", "verdict") else kind: list(range(n)) for kind, n in count.items()}
    assert about["seqs"] == seqs
    assert about["bodies"] == [message for message in messages if message["type"] != "odp"]
    table = pq.read_table(table_file)
    np.testing.assert_array_equal(received["sample"], table["sample"])
    assert len(received["sample"]) == 3 * RATE - 100
    for name in ARRAYS:
        for m in range(MODES):
            assert received[name][:, m].tobytes() == table[f"{name}_{m}"].to_numpy().tobytes()


def run_timed(run, jsonl, listening=None):
    """Run a monitor, stopping its subscriber when it has heard the first second; returns seconds and messages."""
    began = time.monotonic()
    with subprocess.Popen(run, stdout=subprocess.DEVNULL) as monitor:
        if listening is not None:
            while not jsonl.exists() or b"health" not in jsonl.read_bytes():
                assert monitor.poll() is None
                time.sleep(0.01)
            listening.send_signal(signal.SIGSTOP)
        assert monitor.wait(60) == 0
    return time.monotonic() - began, [parse(line) for line in jsonl.read_text().splitlines()]


@pytest.mark.slow
def test_subscribers_that_do_not_listen_delay_nothing(tmp_path, excerpt, publishing):
    """With a stopped subscriber, whose queue runs full, or with none, the worker is as quick and says the same."""
    endpoint, options = publishing(f"ipc://{tmp_path}/socket", high_water_mark=2)
    jsonl = tmp_path / "out.jsonl"
    run = command(excerpt, *options, "--jsonl", jsonl)
    alone_s, alone = run_timed(run, jsonl)
    jsonl.unlink()
    with subscriber(endpoint, tmp_path / "report.npz") as listening:
        stopped_s, stopped = run_timed([*run, "--wait-subscriber", "30"], jsonl, listening)
    assert [m for m in stopped if m["type"] != "health"] == [m for m in alone if m["type"] != "health"]
    for messages, dropped in ((alone, False), (stopped, True)):
        health = [m for m in messages if m["type"] == "health"]
        assert bool(health[-1]["publications_dropped"]) == dropped
        assert [(h["t"], h["lost"]) for h in health] == [(1.0, 0), (2.0, 0), (3 - 100 / RATE, 0)]
        for h in health[:-1]:
            assert h["samples_in"] == pytest.approx(h["t"] * RATE, abs=service.REAL_BLOCK_SAMPLES)
        assert health[1]["latency_ms_p99"] < 250  # the first second loads the kernels
    # starting the subscriber takes a second or two, and closing waits up to two for a stopped one
    assert stopped_s < alone_s + 6


def test_no_kernel_calls_python(bar, tmp_path):  # noqa: ARG001  it has loaded the kernels
    """To make a named tuple Numba would, and die of a keyboard interrupt that comes in that moment."""
    called = set()

    def note(frame, event, _):
        if event == "call" and "numba" in frame.f_code.co_filename:
            called.add((frame.f_code.co_name, frame.f_back.f_code.co_filename, frame.f_back.f_lineno))

    sys.setprofile(note)
    try:
        replay(BAR, tmp_path)
    finally:
        sys.setprofile(None)
    assert "_numba_unpickle" not in {name for name, *_ in called}, called


def test_a_warm_start_compiles_nothing(bar):  # noqa: ARG001  it has compiled the kernels
    """From a warm start the first line is a message, and there was nothing to wait for.

    How long it takes is told by `benchmarks.chain`.
    """
    done = subprocess.run(command(BAR, "--jsonl", "/dev/stdout"), capture_output=True, check=True, timeout=200)
    assert parse(done.stdout.splitlines()[0].decode())["type"] == "odp"
    assert b"Compiling" not in done.stderr


@pytest.mark.slow
@pytest.mark.timeout(1300)  # of two runs, on a slow machine that is busy
def test_the_first_start_compiles_and_hears_the_same(tmp_path):
    """With an empty cache the wait for the compiler is announced on standard error, once; every message is the same."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    settings = tmp_path / "lathe.toml"
    settings.write_text("[spindle]\nspeed_rpm = 1685.0\nteeth = 1\n")
    runs, heard = [], []
    for name in ("first.jsonl", "second.jsonl"):
        arguments = command(BAR, "--config", settings, "--jsonl", tmp_path / name)
        runs.append(subprocess.run(arguments, env=environment, check=True, capture_output=True, text=True, timeout=600))
        messages = map(parse, (tmp_path / name).read_text().splitlines())
        heard.append([message for message in messages if message["type"] != "health"])
    assert "Compiling the kernels for this machine" in runs[0].stderr
    assert runs[1].stderr == ""
    assert heard[0] == heard[1]
    told = [message for message in heard[0] if message["type"] == "verdict" and message["margin_percent"] is not None]
    assert told
    for message in told:
        low, high = message["margin_percent_ci95"]
        assert low < message["margin_percent"] < high
