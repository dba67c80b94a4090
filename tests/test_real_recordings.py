"""Recordings of real machines, where they are at hand: they are not part of the project."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.replaying import replay

DATA = Path(__file__).parents[2] / "shared" / "data"


@pytest.fixture(scope="module")
def replayed(tmp_path_factory):
    """Replay a recording; each once."""
    outcomes = {}

    def replayed(name):
        if not (DATA / name).is_file():
            pytest.skip(f"{name} is not in ../shared/data: recordings of real machines are not part of the project")
        if name not in outcomes:
            outcomes[name] = replay(DATA / name, tmp_path_factory.mktemp("real"))
        return outcomes[name]

    return replayed


def test_milling_chatter_is_found_where_it_is(replayed):
    """The alarm lies within 8 to 17.5 s, covers most of it, and is silent before 7 s and after 19 s."""
    alarms = replayed("ubc_milling_chatter.flac").alarms()
    assert sum(alarm["t1"] - alarm["t0"] for alarm in alarms) > 0.75 * (17.5 - 8)
    assert 8 <= alarms[0]["t0"] <= 9.5
    assert 16 <= alarms[-1]["t1"] <= 17.5


def test_milling_chatter_has_its_frequency_and_no_damping(replayed):
    """In every interval of the alarm with an opinion of its own: 1060 to 1080 Hz with a damping below 0.002."""
    outcome = replayed("ubc_milling_chatter.flac")
    heard = [alarm for alarm in outcome.alarms() if "not died down" not in alarm["reasons"][0]]
    assert len(heard) > 100
    assert all(1060 <= alarm["frequency_hz"] <= 1080 and alarm["damping_ratio"] < 0.002 for alarm in heard)
    for event in outcome.of("event"):
        assert 1060 <= event["peak_frequency_hz"] <= 1080
        assert event["min_damping_ratio"] < 0.002


def test_milling_chatter_is_one_event(replayed):
    """One stretch of chatter is one event."""
    assert len(replayed("ubc_milling_chatter.flac").of("event")) == 1


@pytest.mark.parametrize(
    "name", ["turning_s_320_030_10k.wav", "turning_s_320_040_10k.wav", "ubc_milling_no_chatter.flac"]
)
def test_no_false_alarm(replayed, name):
    """Stable cuts almost as loud as chatter, and forced milling at an unknown speed, raise no alarm."""
    assert replayed(name).alarms() == []
