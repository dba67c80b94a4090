"""Every view of the dashboard as a picture, from a real replay, in rerun's viewer without a screen."""

from __future__ import annotations

import os

import numpy as np
import pytest
from PIL import Image

from chatter_monitor.config import load
from chatter_monitor.outlets.dashboard.place import Place
from chatter_monitor.outlets.look import VERMILLION
from chatter_monitor.service.showing import show_diagnosis, show_recording
from docs.pictures.viewer import LAVAPIPE, viewer
from tests.discrepancy.test_report import REPORT
from tests.replaying import REPLAY_DATA
from tests.system.components import REQUIRED

pytestmark = [pytest.mark.system, pytest.mark.timeout(300)]

CHATTER_S = 12.0
VIEWS = ("evidence", "spectrogram", "poles", "frequency", "damping", "chatter", "waveform")


@pytest.fixture(scope="module", autouse=True)
def _graphics():
    """Mesa's graphics card in software."""
    if not LAVAPIPE.exists():
        if os.environ.get(REQUIRED):
            pytest.fail("no graphics: apt-get install mesa-vulkan-drivers libvulkan1")
        pytest.skip("no graphics: apt-get install mesa-vulkan-drivers libvulkan1")


@pytest.fixture(scope="module")
def pictures(tmp_path_factory):
    """Pictures of all views during chatter, by entity, of everything under no name; what the views complain of."""
    folder = tmp_path_factory.mktemp("pictures")
    saved = folder / "bar.rrd"
    settings = load([], {"spindle": {"speed_rpm": 1685.0}})
    show_recording(REPLAY_DATA / "bar_turning.flac", settings, Place(save=saved), str)
    found = {}
    with viewer(saved) as shown:
        shown.go(CHATTER_S)
        origins = shown.views()
        for origin in ("", *origins):
            path = folder / f"view{origin.replace('/', '_')}.png"
            shown.save(path, origin or None)
            with Image.open(path) as picture:
                found[origin] = np.asarray(picture.convert("RGB")).astype(int)
        complaints = shown.complaints()
    return found, complaints


def share_near(picture, colour, tolerance=40):
    """Share of the pixels that are nearly of a colour."""
    return float((np.abs(picture - np.array(colour)).max(axis=2) < tolerance).mean())


def test_no_view_is_blank(pictures):
    """All views of the arrangement are there, none has anything to complain of, and each shows more than its ground."""
    found, complaints = pictures
    assert set(found) == {"", "/verdict", "/events", *(f"/channel_0/{view}" for view in VIEWS)}
    assert complaints == []
    for origin, picture in found.items():
        ground = np.median(picture.reshape(-1, 3), axis=0)
        drawn = (np.abs(picture - ground).max(axis=2) > 30).mean()
        assert drawn > 0.003, origin


def test_the_alarm_can_be_seen(pictures):
    """The verdict lane is vermillion over about the part of the recording that chatters (8.5 of 20 s)."""
    red, green, blue = np.moveaxis(pictures[0]["/verdict"], 2, 0)
    vermillion = (red > 2.0 * green) & (red > 100) & (blue < 50)  # the viewer darkens what words stand on
    assert vermillion.mean(axis=1).max() == pytest.approx(8.5 / 20, abs=0.06)


def test_the_spectrogram_shows_the_line_that_chatters(pictures):
    """Along the row of 327 Hz the picture is brighter than along most others."""
    picture = pictures[0]["/channel_0/spectrogram"]
    middle = picture[:, picture.shape[1] // 2 : int(0.9 * picture.shape[1])].sum(axis=2)
    lines = np.median(middle, axis=1)
    assert lines.max() > 2.0 * np.median(lines[lines > 30])
    assert share_near(picture, (230, 159, 0)) > 0.0005  # the mode that is tracked, drawn in


def test_how_likely_it_chatters_can_be_seen(pictures):
    """A vermillion line along the top while it does, 8.5 of 20 s, and along the bottom for most of the rest."""
    line = np.abs(pictures[0]["/channel_0/chatter"] - np.array(VERMILLION)).max(axis=2) < 60
    half = len(line) // 2
    top, bottom = line[:half].mean(axis=1).max(), line[half:].mean(axis=1).max()
    assert top == pytest.approx(8.5 / 20, abs=0.08)
    assert bottom > 0.3


def test_the_stability_limit_is_drawn(pictures):
    """A vermillion line runs across the damping view and up through the pole plane."""
    damping = np.abs(pictures[0]["/channel_0/damping"] - np.array(VERMILLION)).max(axis=2) < 60
    assert damping.mean(axis=1).max() > 0.4  # where nothing lies on it
    poles = np.abs(pictures[0]["/channel_0/poles"] - np.array(VERMILLION)).max(axis=2) < 60
    assert poles.mean(axis=0).max() > 0.4


def test_the_waveform_grows(pictures):
    """The drawn band is much higher in the middle of the recording than at its beginning."""
    picture = pictures[0]["/channel_0/waveform"]
    blue = np.abs(picture - np.array((86, 180, 233))).max(axis=2) < 60
    heights = [np.ptp(np.flatnonzero(column)) if column.any() else 0 for column in blue.T]
    n = len(heights)
    assert np.median(heights[n // 2 : n // 2 + n // 10]) > 8 * np.median(heights[n // 8 : n // 5])


def test_a_diagnosis_is_shown(tmp_path):
    """Words and the pictures of a report are on the screen, and none of them is blank."""
    import base64
    import io

    rng = np.random.default_rng(3)
    html = ""
    for title in ("Where they differ", "Recording and simulations"):
        data = io.BytesIO()
        Image.fromarray(rng.integers(0, 255, (60, 90, 3), np.uint8)).save(data, "PNG")
        html += f'<img alt="{title}" src="data:image/png;base64,{base64.b64encode(data.getvalue()).decode()}">'
    (tmp_path / "report.json").write_bytes(REPORT.to_json())
    (tmp_path / "report.html").write_text(html)
    show_diagnosis(tmp_path, Place(save=tmp_path / "d.rrd"), str)
    with viewer(tmp_path / "d.rrd") as shown:
        views = shown.views()
        assert set(views) == {f"/diagnosis/{view}" for view in ("answer", "numbers", "picture_0", "picture_1")}
        for origin in views:
            shown.save(tmp_path / "view.png", origin)
            with Image.open(tmp_path / "view.png") as picture:
                pixels = np.asarray(picture.convert("L"))
            assert (np.abs(pixels - np.median(pixels)) > 30).mean() > 0.003, origin
