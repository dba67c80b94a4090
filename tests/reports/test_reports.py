"""What the reports say, against what the monitor said."""

from __future__ import annotations

import base64
import json
import re
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import msgspec
import numpy as np
import pytest

from chatter_monitor.outlets.event_files import read, read_verdicts
from chatter_monitor.records import Event, Verdict
from chatter_monitor.reports.event import event_page
from chatter_monitor.reports.shift import MOST_BINS, Shift, shift_page
from chatter_monitor.service.reporting import report_event, report_shift


class Seen(HTMLParser):
    """Text of a page, its pictures and whatever it refers to."""

    def __init__(self, page):
        super().__init__()
        self.words, self.sources, self.open, self._hidden = [], [], [], False
        self.feed(page)
        self.text = re.sub(r"\s+", " ", " ".join(self.words))

    def handle_starttag(self, tag, attrs):
        self._hidden = tag == "style"
        self.sources += [value for name, value in attrs if name in ("src", "href", "srcset", "action", "data")]
        if tag not in ("meta", "link", "img", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag
        self._hidden = False

    def handle_data(self, data):
        if not self._hidden:
            self.words.append(data)

    def pictures(self):
        """Roots of the SVG pictures."""
        kind = "data:image/svg+xml;base64,"
        return [
            ET.fromstring(base64.b64decode(source.removeprefix(kind)))  # noqa: S314  our own
            for source in self.sources
            if source.startswith(kind)
        ]


@pytest.fixture(scope="module")
def event_report(entry, tmp_path_factory):
    """The page on the event."""
    path = tmp_path_factory.mktemp("report") / "event.html"
    report_event(entry, path)
    return Seen(path.read_text(encoding="utf-8"))


def verdict(t0, state="stable", channel=0, damping=0.03, margin=None):
    """One interval."""
    sample0 = round(t0 * 12_800)
    ci95 = (damping - 0.01, damping + 0.01)
    return Verdict(
        channel=channel,
        t0=t0,
        t1=t0 + 0.05,
        sample0=sample0,
        sample1=sample0 + 640,
        state=state,
        frequency_hz=400.0,
        damping_ratio=damping,
        damping_ratio_ci95=ci95,
        margin_percent=margin,
    )


def test_the_event_report_answers_the_questions(event_report, entry):
    """When, how long, at what frequency, how sure, why, and what to change are all there, in the event's numbers."""
    recorded = read(entry.json)
    for words in (
        f"{recorded.peak_frequency_hz:.0f} Hz",
        f"{100 * recorded.min_damping_ratio:.2f} %",
        f"{recorded.end_s - recorded.onset_s:.2f} s",
        recorded.onset_utc[11:19],
        recorded.remedy,
        *(f"{advice.spindle_rpm:.0f} rpm" for advice in recorded.advice),
        "grows by itself",
    ):
        assert words in event_report.text, words
    assert re.search(r"9\d % sure", event_report.text)


def test_the_event_report_has_the_verdicts_that_were_given(replayed, entry):
    """Those of the replay that recorded the event, word for word, the ones before the onset included."""
    given = [json.loads(line) for line in (replayed / "bar.jsonl").read_text().splitlines()]
    given = [msgspec.convert(line, Verdict) for line in given if line["type"] == "verdict"]
    recorded = read(entry.json)
    end = recorded.first_sample + recorded.samples
    kept = read_verdicts(entry.path / recorded.verdicts)
    assert kept == [v for v in given if recorded.first_sample <= v.sample0 < end]
    assert kept[0].t1 < recorded.onset_s - 4.0


def test_where_no_speed_can_be_advised(entry):
    """The answer is the advice that there is: without a known speed nobody claims that no other one is better."""
    nothing = "no speed can be advised: neither the spindle's speed nor its range is known"
    recorded = msgspec.structs.replace(read(entry.json), advice=[], remedy=nothing)
    alarm = verdict(recorded.onset_s, "self_excited")
    seen = Seen(event_page(recorded, [alarm], np.ones(round(recorded.sample_rate_hz))))
    [told] = re.findall(r"Hz\. (No .*?\.)", seen.text)
    assert told == f"N{nothing[1:]}."


def test_an_alarm_that_was_withdrawn_is_not_called_chatter(entry):
    """Its page says what it was, that nothing is to be changed, and why it was an alarm."""
    nothing = "nothing: it is on an order of what turns"
    recorded = msgspec.structs.replace(read(entry.json), advice=[], remedy=nothing, withdrawn=True)
    alarm = verdict(recorded.onset_s, "self_excited")
    seen = Seen(event_page(recorded, [alarm], np.ones(round(recorded.sample_rate_hz))))
    assert f"Withdrawn alarm at {recorded.peak_frequency_hz:.0f} Hz" in seen.text
    assert "the cut fed" not in seen.text
    assert f"N{nothing[1:]}." in seen.text
    assert "Why it was called chatter" in seen.text


def test_an_event_in_no_line_has_a_page(entry):
    """Where nobody heard a frequency or a damping the page tells neither."""
    recorded = msgspec.structs.replace(read(entry.json), peak_frequency_hz=None, min_damping_ratio=None, advice=[])
    alarm = verdict(recorded.onset_s, "self_excited")
    seen = Seen(event_page(recorded, [alarm], np.ones(round(recorded.sample_rate_hz))))
    assert "the cut fed a vibration. " in seen.text
    assert "None" not in seen.text


def test_names_are_text(event_report):
    """A machine's name with signs of markup in it is shown as it is and becomes no markup."""
    assert "lathe <3>" in event_report.text
    assert event_report.open == []


def test_nothing_is_fetched_from_elsewhere(event_report):
    """All that the page refers to is inside it."""
    assert len(event_report.sources) >= 2
    assert all(source.startswith("data:") for source in event_report.sources)


def test_the_picture_has_its_four_parts(event_report):
    """The figure is there as SVG with lane, signal, spectrogram and damping."""
    [root] = event_report.pictures()
    groups = {element.get("id") for element in root.iter() if element.get("id")}
    assert {"axes_1", "axes_2", "axes_3", "axes_4"} <= groups
    assert any(element.tag.endswith("image") for element in root.iter())


def test_a_shift_adds_up_to_what_the_monitor_said(replayed, tmp_path):
    """Seconds by state and events are those of the JSON lines, and are on the page."""
    lines = [json.loads(line) for line in (replayed / "bar.jsonl").read_text().splitlines()]
    seconds = {}
    for line in lines:
        if line["type"] == "verdict":
            seconds[line["state"]] = seconds.get(line["state"], 0.0) + line["t1"] - line["t0"]
    [event] = [line for line in lines if line["type"] == "event"]
    shift = report_shift(replayed / "bar.jsonl", tmp_path / "shift.html")
    assert shift.seconds[0] == pytest.approx(seconds)
    assert sum(sum(b.seconds.values()) for b in shift.bins) == pytest.approx(20.0)
    seen = Seen((tmp_path / "shift.html").read_text(encoding="utf-8"))
    chatter_s = shift.seconds[0]["self_excited"]  # 8.45: sums in another order may be rounded the other way
    assert f"{chatter_s:.1f} s of it chatter" in seen.text
    assert f"{event['peak_frequency_hz']:.0f} Hz" in seen.text
    tried = [f"{advice['spindle_rpm']:.0f} rpm" for advice in event["advice"]] or ["less depth of cut"]
    assert ", ".join(tried) in seen.text
    assert len(seen.pictures()) == 1


def test_a_shift_from_recorded_events(replayed, tmp_path, entry):
    """A store gives its events with their wall time, and says that the time between them is not known."""
    shift = report_shift(replayed / "events", tmp_path / "shift.html")
    text = Seen((tmp_path / "shift.html").read_text(encoding="utf-8")).text
    assert [listed.event.id for listed in shift.events] == [entry.id]
    assert read(entry.json).onset_utc[:19].replace("T", " ") in text
    assert "tell nothing of the time between them" in text


def test_a_day_takes_no_more_memory_than_a_minute():
    """After a day the number of bins is bounded, none is lost, and the least damping and margin stay in their place."""
    shift = Shift()
    for k in range(24 * 60):
        shift.verdict(verdict(60.0 * k, damping=-0.02 if k == 700 else 0.03, margin=4.0 if k == 701 else 50.0))
    assert MOST_BINS / 2 <= len(shift.bins) <= MOST_BINS
    assert sum(b.seconds["stable"] for b in shift.bins) == pytest.approx(24 * 60 * 0.05)
    least = min(range(len(shift.bins)), key=lambda k: shift.bins[k].damping)
    assert least * shift.bin_s <= 700 * 60.0 < (least + 1) * shift.bin_s
    assert min(b.margin_percent for b in shift.bins) == 4.0


def test_a_silent_shift_is_not_called_stable():
    """Where nothing could be said for much of the time, the page says that instead of an all-clear."""
    shift = Shift()
    for k in range(100):
        shift.verdict(verdict(0.05 * k, "unknown" if k < 50 else "stable"))
    assert "nothing could be said" in Seen(shift_page(shift, "x", "y")).text
    quiet = Shift()
    quiet.verdict(verdict(0.0))
    assert "nothing could be said" not in Seen(shift_page(quiet, "x", "y")).text


def test_withdrawn_alarms_are_no_chatter_of_a_shift():
    """They are listed as such; one beside them that was not withdrawn counts alone."""
    shift = Shift()
    shift.verdict(verdict(0.0))
    about = {"channel": 0, "kind": "chatter", "peak_frequency_hz": 400.0, "min_damping_ratio": -0.01}
    shift.event(Event(id="a", onset_s=1.0, end_s=5.0, withdrawn=True, **about))
    text = Seen(shift_page(shift, "x", "y")).text
    assert "No chatter." in text
    assert "Alarms that were withdrawn: 1." in text
    assert "nothing: withdrawn" in text
    shift.event(Event(id="b", onset_s=9.0, end_s=10.5, **about))
    assert "1.5 s in 1 event; the longest began at 0:00:09" in Seen(shift_page(shift, "x", "y")).text


def test_idle_time_has_no_damping_margin():
    """The least damping counts only while it cuts."""
    shift = Shift()
    shift.verdict(verdict(0.0, "idle", damping=-0.01))
    shift.verdict(verdict(0.05, "stable", damping=0.02))
    assert shift.bins[0].damping == 0.02


def test_many_events_are_not_all_listed():
    """A thousand events make a page that can still be read, and it says how many are left out."""
    shift = Shift()
    for k in range(1000):
        numbers = {"onset_s": k, "end_s": k + 0.5, "peak_frequency_hz": 400.0, "min_damping_ratio": -0.01}
        shift.event(Event(id=f"e{k}", channel=0, kind="chatter", **numbers))
    assert "And 800 more." in Seen(shift_page(shift, "x", "y")).text


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        (["events", "report", "nobody", "--directory", ".", "--out", "x.html"], 2, "nobody"),
        (["events", "shift", "absent.jsonl", "--out", "x.html"], 2, "absent.jsonl"),
        (["events", "shift", "empty.jsonl", "--out", "x.html"], 2, "no verdicts"),
        (["events", "shift", "broken.jsonl", "--out", "x.html"], 2, "line 2"),
        (["events", "shift", "good.jsonl", "--out", "absent/x.html"], 3, "absent/x.html"),
    ],
)
def test_errors_speak(arguments, code, words, run, tmp_path, monkeypatch):
    """What cannot be reported on says why, and writes nothing."""
    import msgspec

    good = msgspec.json.encode(verdict(0.0)).decode() + "\n"
    for name, content in (("empty", ""), ("good", good), ("broken", good + '{"type":"verdict","t0":"x"}\n')):
        (tmp_path / f"{name}.jsonl").write_text(content)
    monkeypatch.chdir(tmp_path)
    given, _, errors = run(*arguments)
    assert (given, words in errors) == (code, True)
    assert not (tmp_path / "x.html").exists()


def test_the_commands_write_the_pages(replayed, entry, run, tmp_path):
    """`events report` and `events shift` write files and say so; `--json` gives the numbers."""
    code, out, _ = run("events", "report", entry.id, "--directory", replayed / "events", "--out", tmp_path / "e.html")
    assert (code, out) == (0, f"wrote {tmp_path / 'e.html'}\n")
    code, out, _ = run("events", "shift", replayed / "bar.jsonl", "--out", tmp_path / "s.html", "--json")
    assert code == 0
    assert json.loads(out)["events"] == 1
    assert json.loads(out)["seconds_in"]["0"]["self_excited"] > 8.0
    assert (tmp_path / "e.html").exists()
    assert (tmp_path / "s.html").exists()
