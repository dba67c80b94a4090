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
