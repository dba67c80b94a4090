"""Above which amplitude a force acts, on a motion and columns that are made of random numbers."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.discrepancy.case import Threshold
from chatter_monitor.discrepancy.in_part import amplitude

AMPLITUDES = np.array([0.0, 0.5, 1.0, 1.5, 2.0])


def begins_with(gains, monkeypatch):
    """Where a force begins whose gains above `AMPLITUDES` are these."""
    monkeypatch.setattr(amplitude, "_searched", lambda *_: (AMPLITUDES, np.array([gains])))
    case = type("Case", (), {"evidence": type("Evidence", (), {"everything": None})})
    return amplitude.begins(case, (None, []))


def test_a_sharp_likelihood_tells_where_a_force_begins(monkeypatch):
    """The interval ends at the next amplitudes that are not as likely; the gain pays for the amplitude."""
    found = begins_with([20.0, 25.0, 40.0, 26.0, 5.0], monkeypatch)
    assert (found.above, found.ci95) == (1.0, (0.5, 1.5))
    assert found.gain_nats == pytest.approx(40.0 - 20.0 - amplitude.PRICE_NATS)


def test_a_flat_likelihood_does_not(monkeypatch):
    """What explains as much all along has an interval from 0, and gains less than the amplitude costs."""
    found = begins_with([39.0, 39.5, 40.0, 30.0, 5.0], monkeypatch)
    assert found.ci95 == (0.0, 1.5)
    assert found.gain_nats < 0.0


def test_an_amplitude_is_told_with_its_interval():
    """In words: amplitude, unit, 95 % interval."""
    assert str(Threshold(1.234, (1.1, 1.4), 5.0)) == "above an amplitude of 1.23 u (1.1 to 1.4)"
