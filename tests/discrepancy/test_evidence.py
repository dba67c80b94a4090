"""Regression of errors on signatures, on columns of random numbers."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.discrepancy.evidence import Evidence


def test_what_is_known_beforehand_counts_as_its_standard_deviation_says():
    """Two normal variables, each weighted with its reciprocal variance; that they lie apart costs likelihood."""
    rng = np.random.default_rng(3)
    errors, (column, other) = rng.standard_normal(4000), rng.standard_normal((2, 4000))
    evidence = Evidence(errors, np.array([column, other]), np.ones(4000), [], 500)
    alone = evidence.regress([0])
    [by_errors], [sd] = alone.coefficients, alone.sd
    evidence.expect(0, 0.1, 0.02)
    both = evidence.regress([0])
    share = 0.02**-2 / (0.02**-2 + sd**-2)
    assert both.coefficients[0] == pytest.approx(share * 0.1 + (1.0 - share) * by_errors)
    assert both.sd[0] == pytest.approx((0.02**-2 + sd**-2) ** -0.5)
    cost = evidence.rest(both, [0], evidence.everything) - (0.5 * errors @ errors - alone.gain)
    assert cost == pytest.approx(0.5 * (by_errors - 0.1) ** 2 / (sd**2 + 0.02**2))
