"""Which device is meant, and what is said where PortAudio is missing; opening real ones is for the system tests."""

from __future__ import annotations

import sys

import pytest

from chatter_monitor.acquisition import portaudio
from chatter_monitor.acquisition.portaudio import Device, find
from chatter_monitor.errors import EnvironmentFault

DEVICES = [
    Device(0, "HDA Intel PCH: ALC257 Analog (hw:0,0)", "ALSA", 2, False),
    Device(3, "UMIK-1: USB Audio (hw:1,0)", "ALSA", 1, False),
    Device(5, "UMIK-1", "JACK", 1, False),
    Device(7, "front [left]", "ALSA", 2, False),
    Device(8, "default", "ALSA", 32, True),
]


@pytest.mark.parametrize(
    ("wanted", "index"),
    [
        ("default", 8),
        (3, 3),
        ("hw:1,0", 3),  # a part of the name
        ("umik", 3),  # in any case, the first
        ("umik-1", 5),  # an exact name goes before a part
        ("usb*hw", 3),  # a pattern
        ("[left]", 7),  # brackets are themselves
        ("alc25? analog", 0),
    ],
)
def test_the_device_that_is_meant(wanted, index):
    """A device is found by index, exact name, pattern or part of the name, in this order."""
    assert find(DEVICES, wanted).index == index


@pytest.mark.parametrize("wanted", ["hw:2,0", 1, "umik-2", "[l]eft"])
def test_a_device_that_is_not_there(wanted):
    """The error names what was wanted and what there is."""
    with pytest.raises(EnvironmentFault, match="no such sound device") as raised:
        find(DEVICES, wanted)
    assert repr(wanted) in str(raised.value)
    assert "3: UMIK-1: USB Audio (hw:1,0)" in str(raised.value)


def test_renumbering_does_not_matter_to_a_name():
    """The same name is found at another index after devices have come and gone."""
    renumbered = [Device(1, "UMIK-1: USB Audio (hw:2,0)", "ALSA", 1, False)]
    assert find(renumbered, "umik").index == 1


def test_default_without_a_default():
    """Where the system has no choice of its own, a device of that name is taken, and no other."""
    assert find([Device(2, "Default ALSA Device", "ALSA", 2, False)], "default").index == 2
    with pytest.raises(EnvironmentFault):
        find(DEVICES[:3], "default")


def test_without_portaudio_the_error_says_what_to_install(monkeypatch):
    """Everything can be imported without the library; asking it for something is told with a remedy."""
    monkeypatch.setitem(sys.modules, "sounddevice", None)  # importing it fails
    with pytest.raises(EnvironmentFault, match="apt install libportaudio2"):
        portaudio.version()
