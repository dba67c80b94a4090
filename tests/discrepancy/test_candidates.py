"""Candidate forces, and which of them are one and the same."""

from __future__ import annotations

import pytest

from chatter_monitor.discrepancy.candidates import candidates
from chatter_monitor.physics.parts import Spindle


@pytest.mark.parametrize("size", [(1e-6, 2e-3), (1.0, 2e3), (30.0, 6e4)])
def test_every_shape_is_a_force_of_its_own_whatever_the_unit(size):
    """A gap or a chip far wider than one unit is another force than the next, in metres as in micrometres."""
    tried = [
        c for c in candidates(*size, Spindle(6000.0), regenerates=True) if c.name in ("clearance", "loss_of_contact")
    ]
    assert len({c.acts(0, size) for c in tried}) == len(tried)


def test_a_force_that_two_terms_share_is_one():
    """Dry friction without a width, and the part of Stribeck friction that is left once it slides."""
    size = (1.0, 2e3)
    dry = next(c for c in candidates(*size, None) if c.name == "coulomb_friction" and c.shapes == 0)
    stribeck = next(c for c in candidates(*size, None) if c.name == "stribeck_friction")
    assert dry.acts(0, size) == stribeck.acts(0, size)
    assert dry.acts(0, size) != stribeck.acts(1, size)


def test_a_tool_that_leaves_the_cut_early_needs_no_delay_in_the_spectrum():
    """A long chip without a delay that was found is that delay; and without a spindle nothing is delayed."""

    def chips(spindle, regenerates):
        tried = candidates(1.0, 2e3, spindle, regenerates=regenerates)
        return [(c.values[1], c.shapes) for c in tried if c.name == "loss_of_contact"]

    assert chips(Spindle(6000.0), regenerates=True)[-1] == (3.0, 0)
    assert chips(Spindle(6000.0), regenerates=False) == [(0.3, 1), (0.6, 1), (1.0, 1)]
    assert chips(None, regenerates=False) == []
