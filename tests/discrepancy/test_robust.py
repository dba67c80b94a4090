"""A diagnosis under trouble: a right answer or `unknown`, never a confident wrong one (`benchmarks.robust` counts)."""

from __future__ import annotations

import pytest

from benchmarks.robust import answer, case, judged


@pytest.mark.parametrize("trouble", ["wrong speed", "wrong quantity", "second machine", "clipped", "silence"])
def test_trouble_makes_no_wrong_name(trouble):
    """A hard joint in trouble gets its own name, that of the trouble, or none."""
    report = answer(*case("hardening", trouble, 140, seconds=6.0))
    assert judged("hardening", trouble, report) in ("right", "unknown"), report.summary
