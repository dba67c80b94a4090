"""The flight recorder in the monitor: what reaches it, and what it reports."""

from __future__ import annotations

import time

import msgspec
import numpy as np

from chatter_monitor.acquisition.synthetic import Synthetic
from chatter_monitor.config import Settings, load
from chatter_monitor.discrepancy.live.settings import ModelSettings
from chatter_monitor.outlets.control import SetSpindle
from chatter_monitor.outlets.event_files import read
from chatter_monitor.outlets.event_store import EventStore, EventWriter
from chatter_monitor.outlets.outlet import Outlet
from chatter_monitor.records import Health, Mismatch
from chatter_monitor.service.monitor import Monitor
from chatter_monitor.service.recorder import open_recorder
from chatter_monitor.tracking.spindle import SpindleSettings
from tests.outlets.recorder_feed import CLOCK
from tests.signals import RATE_HZ, onset, vibration


class Told(Outlet):
    """Remembers what it is told in which order, and has a problem."""

    def __init__(self):
        self.story = []
        self.health = []

    def block(self, block):
        self.story.append(("block", block.first_sample, block.first_sample + len(block.samples)))

    def spindle(self, spindle):
        self.story.append(("spindle", spindle))

    def frame(self, frame, odp):  # noqa: ARG002
        self.story.append(("frame", frame.first_sample, frame.first_sample + len(frame)))

    def message(self, message):
        if isinstance(message, Health):
            self.health.append(message)

    def problems(self):
        return ["the disk is full"]

    def close(self):
        pass


def monitored(signal, outlet, settings=None, commands=lambda: ()):
    source = Synthetic.from_array(signal, RATE_HZ, block_samples=1000)
    monitor = Monitor(
        settings or Settings(),
        source,
        [outlet],
        counts=source,
        source_rate_hz=RATE_HZ,
        session="cut",
        clock=time.perf_counter,
        commands=commands,
    )
    for _ in monitor.run():
        pass


def test_an_outlet_gets_blocks_before_their_frames():
    """Every sample reaches an outlet in a block before it is part of a frame; its problems stand in every health."""
    told = Told()
    monitored(vibration(25_600, [(400, 0.03)]), told)
    seen = 0
    for kind, begin, end in told.story:
        if kind == "block":
            assert begin == seen
            seen = end
        else:
            assert end <= seen
    assert seen == 25_600
    assert len(told.health) == 3
    assert all("the disk is full" in health.reasons for health in told.health)


def test_an_outlet_hears_of_another_spindle_speed():
    """A command to the judges reaches the outlets before the block that it takes effect with."""
    told = Told()
    waiting = [[], [SetSpindle(rpm=1700.0, teeth=4)], []]
    monitored(vibration(3000, [(400, 0.03)]), told, commands=lambda: waiting.pop(0))
    kinds = [kind for kind, *_ in told.story if kind != "frame"]
    assert kinds == ["block", "spindle", "block", "block"]
    assert ("spindle", SpindleSettings(1700.0, 4)) in told.story


def test_settings_of_a_recording_are_those_of_the_monitor(tmp_path):
    """Loading the JSON of an event gives the settings that its verdicts came from, for all its channels."""
    config = tmp_path / "machine.toml"
    config.write_text(
        '[machine]\nname = "lathe-3"\n[input]\nchannels = [2, 0]\nfull_scale_per_unit = 0.5\n'
        "[spindle]\nspeed_rpm = 1700\n[verdict]\nalarm_probability = 0.7\n[tracker]\nmemory_ms = 70\n"
        "[orders]\nlost_s = 2.5\n"
    )
    settings = load([config])
    store = EventWriter(tmp_path / "events", 1e9)
    cut = onset(32_000, 12_800)
    with open_recorder(settings, store, 2, 48_000.0, utc_of=CLOCK.utc_of, patient=True) as recorder:
        monitored(np.stack([cut, cut], axis=1), recorder, settings)
    entries = EventStore(tmp_path / "events").entries()
    assert [read(entry.json).channel for entry in entries] == [0, 1]
    for entry in entries:
        again = load([entry.json])
        for table in ("machine", "spindle", "tracker", "orders", "verdict"):
            assert getattr(again, table) == getattr(settings, table)
        assert again.input == msgspec.structs.replace(settings.input, channels=None)
        assert read(entry.json).source_rate_hz == 48_000.0


def test_a_model_does_not_travel_with_an_event(tmp_path):
    """What a recorder is told of a mismatch is left out, and so is the model's file: no verdict hangs on it."""
    settings = load([], {"model": {"file": "bar.model.toml"}})
    cut = onset(32_000, 12_800)
    with open_recorder(settings, EventWriter(tmp_path, 1e9), 1, RATE_HZ, utc_of=CLOCK.utc_of, patient=True) as recorder:
        recorder.message(Mismatch(channel=0, t=0.0, sample=0, since_s=0.0, outcome="none"))
        monitored(cut, recorder)
    [entry] = EventStore(tmp_path).entries()
    assert load([entry.json]).model == ModelSettings()
