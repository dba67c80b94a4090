"""A diagnosis under trouble: a right answer or `unknown`, never a confident wrong one (`benchmarks.robust` counts)."""

from __future__ import annotations

import pytest

from benchmarks.robust import answer, case, judged


@pytest.mark.parametrize("trouble", ["wrong speed", "wrong quantity", "second machine", "clipped", "silence"])
def test_trouble_makes_no_wrong_name(trouble):
    """A hard joint in trouble gets its own name, that of the trouble, or none."""
    report = answer(*case("hardening", trouble, 140, seconds=6.0))
    assert judged("hardening", trouble, report) in ("right", "unknown"), report.summary


def test_a_machine_that_hides_the_delay_makes_no_loss_of_contact():
    """A second machine has the place in the spectrum, and a chip of 2 rms stands for the delay alone."""
    report = answer(*case("delay", "second machine", 100))
    assert judged("delay", "second machine", report) == "unknown", report.summary
