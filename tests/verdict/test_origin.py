"""Whether an alarm is about what has grown out of a mode, and whether what turns explains it then."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.kernels.vibration import NO_LINE, VIBRATION
from chatter_monitor.tracking.orders import OrderLine, Orders
from chatter_monitor.verdict.origin import OWN, SOON_S, Origin
from chatter_monitor.verdict.vibrations import Told

INTERVAL_S = 0.05
SOON = round(SOON_S / INTERVAL_S)
HERE_HZ = 240.0
NOTHING_TURNS = Orders(0, None, None, None, 0.0)


def alarm_at(hertz):
    """An alarm about a vibration there."""
    vibrations = np.zeros(1, VIBRATION)
    vibrations["frequency_hz"], vibrations["alarm_for"], vibrations["line"] = hertz, 5, NO_LINE
    return Told(Told().overview._replace(alarm=0), vibrations)


def comb(rotation_hz, **rms):
    """A comb with so much at some orders."""
    lines = [OrderLine(int(order[1:]), int(order[1:]) * rotation_hz, value) for order, value in rms.items()]
    return Orders(0, rotation_hz, 0.01, "found", 0.9, tuple(lines))


ITSELF = comb(HERE_HZ, x1=0.9, x2=0.1, x3=0.2)


def alarm(*, grown_hz=HERE_HZ, alarm_hz=HERE_HZ, later=3, goes_on=10, is_cut=False):
    """An alarm that begins so many intervals after something has grown, and goes on for others."""
    origin = Origin(INTERVAL_S)
    calm = {"is_cut": is_cut, "by_line": False, "goes_on": False}
    origin.hear(grown_hz, Told(), **calm)
    for _ in range(later - 1):
        origin.hear(None, Told(), **calm)
    for i in range(1 + goes_on):
        origin.hear(None, alarm_at(alarm_hz), is_cut=False, by_line=True, goes_on=i > 0)
    origin.hear(None, Told(), is_cut=False, by_line=False, goes_on=True)
    return origin


def test_what_grew_out_of_a_mode_outlasts_its_own_comb():
    """As long as its alarm goes on, and though its frequency has moved by a few per cent."""
    assert alarm().outlasts(ITSELF)
    assert alarm(alarm_hz=0.95 * HERE_HZ, goes_on=200).outlasts(comb(0.95 * HERE_HZ, x1=1.0))
    assert not alarm(grown_hz=None).outlasts(ITSELF)


@pytest.mark.parametrize(
    ("turns", "outlasts"),
    [
        (comb(HERE_HZ / 9.0, x9=0.9, x18=0.2, x36=0.1), True),  # its own, and low
        (comb(HERE_HZ / 9.0, x9=0.9, x18=0.2, x5=0.01), True),  # and some noise
        (comb(HERE_HZ / 20.0, x20=0.6, x21=0.2, x15=0.1), False),  # teeth that meet its mode
        (comb(2.0 * HERE_HZ, x1=0.5), True),  # of its overtones only
        (NOTHING_TURNS, False),
        (comb(HERE_HZ, x1=0.0), False),
        (Orders(0, 10.0, 0.1, "given", 0.0), False),
    ],
)
def test_its_own_are_its_overtones(turns, outlasts):
    """Nearly all of the power is in them. Of a cut that repeated before the mode alone is enough."""
    assert alarm().outlasts(turns) is outlasts
    assert alarm(is_cut=True).outlasts(turns)


@pytest.mark.parametrize(("own", "outlasts"), [(OWN + 0.002, True), (OWN - 0.002, False)])
def test_nearly_all_of_the_power_has_to_be_its_own(own, outlasts):
    """What else turns is of another making."""
    assert alarm().outlasts(comb(HERE_HZ / 4.0, x4=own**0.5, x5=(1.0 - own) ** 0.5)) is outlasts


@pytest.mark.parametrize(("later", "soon"), [(1, True), (SOON, True), (SOON + 1, False)])
def test_an_alarm_comes_soon(later, soon):
    """What grew long before is not what it is about."""
    assert alarm(later=later).outlasts(ITSELF) is soon


def test_it_is_about_what_grew():
    """Another line is an alarm of its own."""
    assert not alarm(alarm_hz=1.2 * HERE_HZ).outlasts(comb(1.2 * HERE_HZ, x1=1.0))


def test_each_alarm_has_an_origin_of_its_own():
    """The next is about something else until it is known better, and so is that of the next cut."""
    origin = alarm(goes_on=SOON)
    origin.hear(None, Told(), is_cut=False, by_line=False, goes_on=False)
    origin.hear(None, alarm_at(HERE_HZ), is_cut=False, by_line=True, goes_on=False)
    assert not origin.outlasts(ITSELF)
    origin.hear(HERE_HZ, Told(), is_cut=False, by_line=False, goes_on=False)
    origin.rest()
    origin.hear(None, alarm_at(HERE_HZ), is_cut=False, by_line=True, goes_on=False)
    assert not origin.outlasts(ITSELF)
