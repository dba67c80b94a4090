"""What confirms a name, on columns of random numbers whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from chatter_monitor.discrepancy.candidates import candidates
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.name import Contest

BLOCKS, BLOCK = 20, 500
TRUE, FEIGNED = (
    next(each for each in candidates(1.0, 1.0, None) if each.name == name)
    for name in ("cubic_stiffness", "quadratic_stiffness")
)


def contest(share: float, together: bool) -> Contest:
    """Two columns: one that acts all along, and one that chance has in the errors of the training blocks."""
    rng = np.random.default_rng(11)
    errors, (nuisance, acts, chance) = rng.standard_normal(BLOCKS * BLOCK), rng.standard_normal((3, BLOCKS * BLOCK))
    training = np.arange(BLOCKS * BLOCK) // BLOCK % 2 == 0
    chance[training] += 0.12 * errors[training]
    errors = errors + share * acts
    evidence = Evidence(errors, np.array([nuisance, acts, chance]), np.ones(errors.size), [0], BLOCK)
    return Contest(evidence, [(TRUE, [1]), (FEIGNED, [2])], together=together)


@pytest.mark.parametrize(("together", "names"), [(False, []), (True, ["cubic_stiffness"])])
def test_half_of_the_blocks_may_lead_to_a_wrong_name(together, names):
    """What leads there is not confirmed; all blocks together say what acts, and all of them together confirm it."""
    judged = contest(0.065, together)
    leading = max(judged.best([], judged.training).values(), key=lambda each: each[0])
    assert leading[1] is FEIGNED
    named, ranking = judged.run()
    assert [scored.candidate.name for scored in named] == names
    assert ranking[0].candidate is TRUE


def test_what_chance_does_in_half_of_the_blocks_is_not_confirmed_by_all():
    """Coefficients of the training blocks have to explain something of the others."""
    assert contest(0.0, together=True).run()[0] == []
