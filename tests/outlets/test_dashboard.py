"""What the dashboard draws of a replay, read back from its file and compared with what the monitor said."""

from __future__ import annotations

import contextlib
import io
import itertools

import msgspec
import numpy as np
import pytest

from chatter_monitor.acquisition.recording import Recording
from chatter_monitor.config import load
from chatter_monitor.outlets.dashboard import words
from chatter_monitor.outlets.dashboard.drawing import Drawing
from chatter_monitor.outlets.dashboard.place import Place, open_place
from chatter_monitor.outlets.dashboard.plane import height
from chatter_monitor.outlets.dashboard.screen import Screen
from chatter_monitor.outlets.dashboard.spectrogram import LOWEST_DB, ROWS_PER_OCTAVE
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Event, Health, Verdict
from chatter_monitor.service.replay import Replay
from tests.messages import event
from tests.replaying import REPLAY_DATA
from tests.rrd import Rrd

FILE = REPLAY_DATA / "bar_turning.flac"
INTERVAL_S = 0.05


class Kept(Outlet):
    """Keeps everything, to compare with."""

    def __init__(self):
        self.frames, self.messages = [], []

    def frame(self, frame, odp):  # noqa: ARG002
        self.frames.append(frame)

    def message(self, message):
        self.messages.append(message)

    def close(self):
        pass

    def of(self, kind):
        """Messages of one kind."""
        return [message for message in self.messages if isinstance(message, kind)]


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A replay of chatter on a lathe: the file that the dashboard saved, and what the monitor said."""
    path = tmp_path_factory.mktemp("dashboard") / "bar.rrd"
    kept = Kept()
    with (
        open_place(Place(save=path), FILE.name, "recording") as shown,
        Drawing(Screen(shown.stream, 20.0)) as drawing,
        contextlib.redirect_stdout(io.StringIO()),
    ):
        settings = load([], {"spindle": {"speed_rpm": 1685.0}})
        Replay(file=FILE, settings=settings, witnesses=(drawing, kept)).run(as_json=True)
    return Rrd(path), kept


def test_the_lane_has_every_change_of_the_verdict(drawn):
    """The lane's states and times are those of the verdicts, the alarm among them, and it ends with the signal."""
    rrd, kept = drawn
    verdicts = kept.of(Verdict)
    changes = [
        (verdicts[0].t0, verdicts[0].state),
        *((after.t0, after.state) for before, after in itertools.pairwise(verdicts) if before.state != after.state),
        (verdicts[-1].t1, ""),
    ]
    lane = [(t, state[0]) for t, state in rrd.rows("/verdict/channel_0", "StateChange:state")]
    assert "self_excited" in {state for _, state in lane}
    assert [state for _, state in lane] == [state for _, state in changes]
    np.testing.assert_allclose([t for t, _ in lane], [t for t, _ in changes], atol=1e-6)


def test_modes_have_their_damping_with_its_interval(drawn):
    """Where a mode is drawn, its three numbers are the medians of its estimates and 1.96 standard deviations beside."""
    rrd, kept = drawn
    times, damping = rrd.series("/channel_0/damping/modes")
    np.testing.assert_allclose(times, INTERVAL_S * np.arange(len(kept.frames)), atol=1e-6)
    modes = kept.frames[0].frequency_hz.shape[1]
    assert damping.shape == (400, 3 * modes + 1)
    drawn_rows = np.argwhere(np.isfinite(damping[:, 1 : 3 * modes : 3]))
    assert len(drawn_rows) > 400  # more than a mode, most of the time
    for row, mode in drawn_rows[::37]:
        frame = kept.frames[row]
        rows = frame.status[:, mode] == 0
        middle = np.median(frame.damping_ratio[rows, mode])
        half = 1.96 * np.median(frame.damping_sd[rows, mode])
        expected = 100.0 * np.array([middle - half, middle, middle + half])
        np.testing.assert_allclose(damping[row, 3 * mode : 3 * mode + 3], expected, rtol=1e-6)
    assert (damping[:, -1] == 0.0).all()  # the stability limit


def test_the_vibration_of_the_verdict_is_drawn(drawn):
    """Frequency, damping and interval of each verdict are there, and nothing where it names no vibration."""
    rrd, kept = drawn
    verdicts = kept.of(Verdict)
    _, frequency = rrd.series("/channel_0/frequency/verdict")
    _, damping = rrd.series("/channel_0/damping/verdict")
    nan = float("nan")
    np.testing.assert_allclose(frequency[:, 0], [v.frequency_hz or nan for v in verdicts])
    expected = [
        (nan,) * 3
        if v.damping_ratio_ci95 is None
        else (100 * v.damping_ratio_ci95[0], 100 * v.damping_ratio, 100 * v.damping_ratio_ci95[1])
        for v in verdicts
    ]
    np.testing.assert_allclose(damping, expected)


def test_how_likely_it_chatters_is_drawn(drawn):
    """That of each verdict in percent, and nothing where it is not known: low before the onset, high after it."""
    rrd, kept = drawn
    times, likely = rrd.series("/channel_0/chatter")
    told = [v.chatter_probability for v in kept.of(Verdict)]
    np.testing.assert_allclose(likely[:, 0], [float("nan") if p is None else 100.0 * p for p in told])
    assert np.nanmedian(likely[times < 4.0]) < 10.0
    assert np.nanmedian(likely[(times > 8.0) & (times < 14.0)]) > 90.0


def test_the_waveform_has_the_extremes_of_the_recording(drawn):
    """Largest and smallest of all pairs are those of the recording, to the bits of a float."""
    rrd, _ = drawn
    with Recording(FILE) as recording:
        samples = np.concatenate([block.samples[:, 0] for block in recording.blocks()])
    times, extremes = rrd.series("/channel_0/waveform")
    assert len(times) == 4000
    np.testing.assert_allclose(np.diff(times), 0.005, atol=1e-6)
    assert extremes.max() == pytest.approx(samples.max(), rel=1e-6)
    assert extremes.min() == pytest.approx(samples.min(), rel=1e-6)
    assert times[np.argmax(extremes[:, 1])] == pytest.approx(np.argmax(samples) / 12_800, abs=0.005)


def test_the_spectrogram_has_a_tile_for_each_half_second(drawn):
    """Tiles come one after the other; during chatter the brightest row is that of its frequency."""
    rrd, kept = drawn
    event = kept.of(Event)[0]
    tiles = {}
    for slot in range(41):
        entity = f"/channel_0/spectrogram/strip/{slot}"
        if entity in rrd.entities:
            for t, pixels in rrd.rows(entity, "DepthImage:buffer"):
                tiles[round(t, 3)] = np.frombuffer(bytes(pixels[0]), np.uint8).reshape(-1, 10)
    assert sorted(tiles) == [0.5 * (k + 1) for k in range(40)]
    tile = tiles[10.5]
    assert len(tile) == ROWS_PER_OCTAVE * 7
    brightest = np.argmax(tile, axis=0)
    row = height(event.peak_frequency_hz, len(tile))
    assert np.abs(brightest + 0.5 - row).max() <= 1.0
    # a sinusoid of this amplitude at the recording's loudest
    assert tile.max() + LOWEST_DB == pytest.approx(20 * np.log10(0.4 / np.sqrt(2)), abs=2.0)


def test_modes_are_drawn_into_the_spectrogram(drawn):
    """In the tile at 10.5 s marks lie on the row of the vibration that chatters, one for each column."""
    rrd, kept = drawn
    hertz = kept.of(Event)[0].peak_frequency_hz
    rows = [
        row
        for slot in range(41)
        if (entity := f"/channel_0/spectrogram/strip/{slot}") in rrd.entities
        for row in rrd.rows(entity, "Points2D:positions")
    ]
    marks = np.array(next(places for t, places in rows if t == pytest.approx(10.5)))
    on_it = marks[np.abs(marks[:, 1] - height(hertz, ROWS_PER_OCTAVE * 7)) < 1.0]
    assert sorted(on_it[:, 0]) == [k + 0.5 for k in range(10)]


def test_poles_cross_the_limit_where_it_chatters(drawn):
    """The ringed pole lies left of the limit before the onset, and where the verdict's damping says afterwards."""
    rrd, kept = drawn
    rows = rrd.rows("/channel_0/poles/now", "Points2D:positions")
    ringed = {t: places[0] for t, places in rows if places}
    verdicts = {round(v.t0, 3): v for v in kept.of(Verdict)}
    compared = 0
    for t, (x, y) in ringed.items():
        verdict = verdicts[round(t, 3)]
        if verdict.frequency_hz is not None and 6.0 < t < 15.0:
            assert x == pytest.approx(-verdict.damping_ratio * verdict.frequency_hz, abs=1e-3)
            assert y == pytest.approx(height(verdict.frequency_hz, 140.0), rel=1e-3)
            compared += 1
    assert compared > 30
    assert max(x for t, (x, _) in ringed.items() if 6.6 < t < 8.0) > 0.0


def test_words_say_what_it_is_and_what_to_change(drawn):
    """The evidence during chatter has its word, numbers and reasons; the event is written down with its remedy."""
    rrd, kept = drawn
    event = kept.of(Event)[0]
    verdict = next(v for v in kept.of(Verdict) if v.state == "self_excited")
    texts = dict(rrd.rows("/channel_0/evidence", "TextDocument:text"))
    [text] = next(text for t, text in texts.items() if t == pytest.approx(verdict.t0))
    assert text.startswith("# CHATTER")
    assert f"{verdict.frequency_hz:.0f} Hz" in text
    assert f"{100 * verdict.damping_ratio:.2f} %" in text
    assert all(reason in text for reason in verdict.reasons)
    lines = [line for _, [line] in rrd.rows("/events/chatter", "TextLog:text")]
    assert len(lines) == 2
    assert f"{event.peak_frequency_hz:.0f} Hz" in lines[0]
    assert event.remedy in lines[1]


def test_words_of_an_alarm_that_is_withdrawn():
    """It was not chatter, and nothing is to be changed."""
    happened, change = words.event(event(withdrawn=True, remedy="nothing: it is on an order"))
    assert "an alarm that is withdrawn, for 1.00 s at 900 Hz" in happened
    assert change == "Change: nothing: it is on an order."


@pytest.mark.parametrize(
    ("state", "percent", "interval", "said"),
    [
        ("stable", 41.7, (20.4, 76.9), "**42 %** more depth of cut before it chatters (95 %: 20 to 77 %)\n"),
        ("stable", 41.7, (20.4, 300.0), "chatters (95 %: at least 20 %)\n"),
        ("stable", 421.0, (120.0, 900.0), "**over 100 %** more depth of cut before it chatters\n"),
        ("stable", 140.0, (60.0, 400.0), "**over 100 %** more depth of cut before it chatters (95 %: at least 60 %)\n"),
        ("stable", 4.0, (-3.0, 11.0), "**4 %** more depth of cut before it chatters (95 %: 0 to 11 %)\n"),
        ("stable", -3.0, (-8.0, 4.0), "**0 %** more depth of cut before it chatters (95 %: 0 to 4 %)\n"),
        ("approaching", 70.0, (31.0, 120.0), None),
        ("forced", 421.0, (120.0, 900.0), None),
        ("stable", None, None, None),
    ],
)
def test_the_margin_is_said_where_it_matters(messages, state, percent, interval, said):
    """The words have the margin and its interval up to twice the depth, and none where it is forced, or grows."""
    verdict = next(message for message in messages if isinstance(message, Verdict))
    margin = {"margin_percent": percent, "margin_percent_ci95": interval}
    told = words.evidence(msgspec.structs.replace(verdict, state=state, **margin))
    assert ("depth" in told) == (said is not None)
    assert said is None or said in told


@pytest.mark.parametrize(
    ("state", "probability", "said"),
    [
        ("stable", 0.004, "- that it chatters: **< 1 %**"),
        ("forced", 0.173, "- that it chatters: **17 %**"),
        ("approaching", 0.4, "- that it chatters: **40 %**"),
        ("self_excited", 0.98, None),
        ("idle", 0.0, None),
        ("unknown", None, None),
    ],
)
def test_how_likely_it_chatters_is_said_of_a_cut_without_an_alarm(messages, state, probability, said):
    """An alarm is as sure as that; in air it goes without saying."""
    verdict = next(message for message in messages if isinstance(message, Verdict))
    told = words.evidence(msgspec.structs.replace(verdict, state=state, chatter_probability=probability))
    assert ("that it chatters" in told) == (said is not None)
    assert said is None or said in told.splitlines()


def test_health_is_shown(drawn):
    """The newest state of health is the last message's, and the log tells when it changed."""
    rrd, kept = drawn
    last = kept.of(Health)[-1]
    text = rrd.rows("/health/now", "TextDocument:text")[-1][1][0]
    assert last.state == "finished"
    assert "| state | finished |" in text
    assert [line for _, [line] in rrd.rows("/events/health", "TextLog:text")] == ["hearing", "finished"]


def test_a_pause_of_the_monitor_is_a_gap(tmp_path):
    """Between two verdicts that do not follow each other the lane is empty, and tiles do not run on."""
    path = tmp_path / "gap.rrd"
    with open_place(Place(save=path), "gap", "recording") as shown:
        screen = Screen(shown.stream)
        for t0 in (0.0, 0.05, 30.0, 30.05):
            sample0 = round(t0 * 12_800)
            screen.message(
                Verdict(channel=0, t0=t0, t1=t0 + 0.05, sample0=sample0, sample1=sample0 + 640, state="stable")
            )
        screen.close()
    lane = [(t, state[0]) for t, state in Rrd(path).rows("/verdict/channel_0", "StateChange:state")]
    assert [state for _, state in lane] == ["stable", "", "stable", ""]
    np.testing.assert_allclose([t for t, _ in lane], [0.0, 0.1, 30.0, 30.1], atol=1e-6)


def test_every_channel_has_its_views(tmp_path):
    """Two channels have a lane each, and the arrangement that is sent last has the views of both."""
    path = tmp_path / "two.rrd"
    with open_place(Place(save=path), "two", "recording") as shown:
        screen = Screen(shown.stream)
        for channel in (1, 0):
            screen.message(Verdict(channel=channel, t0=0.0, t1=0.05, sample0=0, sample1=640, state="idle"))
        screen.close()
    rrd = Rrd(path)
    assert {"/verdict/channel_0", "/verdict/channel_1"} <= rrd.entities
    assert {f"/channel_{c}/poles/axes" for c in (0, 1)} <= rrd.entities
