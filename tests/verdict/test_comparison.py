"""What is new is called by where it has been, for as long as the cut is the same."""

from __future__ import annotations

import pytest

from chatter_monitor.verdict.comparison import Comparison
from chatter_monitor.verdict.same_cut import SameCut
from tests.verdict.test_same_cut import AIR, CHATTER_HZ, PASSING_HZ, noise, spectra, teeth, tone


@pytest.fixture
def comparison():
    """With a cut of teeth and noise."""
    return Comparison(SameCut(spectra(teeth() + 0.3 * noise(2)), AIR))


def test_overtones_that_have_most_of_it_for_a_moment_do_not_name_it(comparison):
    """Its share is that of now."""
    chatter, overtone = (spectra(teeth() + 0.3 * noise(n) + a * tone(f)) for n, a, f in ((3, 4, 731), (4, 5, 2193)))
    for spectrum in [*chatter[:5], overtone[0]]:
        comparison.hear(spectrum, 0.0)
        assert comparison.new is None or comparison.new.hertz == pytest.approx(CHATTER_HZ, abs=12.5)
    assert comparison.new.share == pytest.approx(12.5 / (12.5 + 1.08 + 0.09), abs=0.05)
    for spectrum in overtone[1:6]:
        comparison.hear(spectrum, 0.0)
    assert comparison.new.hertz == pytest.approx(3 * CHATTER_HZ, abs=12.5)


def test_a_blow_speaks_against_it(comparison):
    """As far as it made the power."""
    for spectrum in spectra(teeth() + 0.3 * noise(5) + 2.0 * tone(CHATTER_HZ))[:8]:
        comparison.hear(spectrum, 0.6)
    assert comparison.new is None


def test_another_cut_clears_what_was_told(comparison):
    """Nothing is new in what is not the same."""
    chatter = spectra(teeth() + 0.3 * noise(6) + 2.0 * tone(CHATTER_HZ))[:3]
    other = spectra(teeth(101.7) + 0.3 * noise(7))
    for spectrum in chatter:
        comparison.hear(spectrum, 0.0)
    assert comparison.same
    assert comparison.new is not None
    for spectrum in other:
        comparison.hear(spectrum, 0.0)
    assert (comparison.same, comparison.was_same, comparison.new) == (False, True, None)
    for spectrum in spectra(teeth() + 0.3 * noise(6) + 1.5 * tone(2001.0))[:3]:
        comparison.hear(spectrum, 0.0)
    assert comparison.new.hertz == pytest.approx(2001.0, abs=12.5)  # and not where it was


def test_what_drowns_the_cut_ends_nothing(comparison):
    """What chatters may be in no line, and louder than all."""
    for spectrum in spectra(teeth() + 0.3 * noise(8) + 4.0 * tone(CHATTER_HZ))[:5]:
        comparison.hear(spectrum, 0.0)
    for spectrum in spectra(teeth() + 80.0 * noise(9)):
        comparison.hear(spectrum, 0.0)
        assert comparison.new is not None


def test_another_speed_is_no_news(comparison):
    """The lines of before are gone, and what forces the cut now is not new power, from the first spectrum on."""
    for spectrum in spectra(teeth() + 0.3 * noise(10))[:5]:
        comparison.hear(spectrum, 0.0)
    for spectrum in spectra(3.0 * teeth(1.3 * PASSING_HZ) + 0.3 * noise(11)):
        comparison.hear(spectrum, 0.0)
        assert comparison.new is None
