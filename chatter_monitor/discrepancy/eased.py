"""Dry friction that eases once it slides, told from dry friction that does not.

One law has the other in it, so that it never explains less. Where a recording knows little of stiction, what the best
one explains more, and what a parameter costs, say little of which law it was. Likelihoods averaged over the stictions
that physics allows do: with both laws as likely beforehand, the larger average errs least often.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

from chatter_monitor.discrepancy.augment import DAMPING_KNOWN, Augmented
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.name import within
from chatter_monitor.physics.parts import AppliedTerm

SLIDING, EASED = "coulomb_friction", "stribeck_friction"
STICTIONS = np.linspace(0.1, 3.0, 30)  # over the friction at high velocity: at rest it is up to four times as large


def eased(case: Case, sliding: Augmented) -> AppliedTerm | None:
    """Friction that eases, if that is likelier than the friction of a model; the likeliest one.

    Both laws are held against the errors of that model, about which all is linear: every stiction and velocity over
    which it may fade is one signature, beside what else was fitted. What the model file says of the damping counts, as
    the broadest of these laws are friction and a damper.

    Parameters
    ----------
    case : Case
    sliding : Augmented
        Model with friction that does not ease, fitted, as its one term that was found.
    """
    inn, found = sliding.innovations, sliding.system.terms[-1]
    easing = [candidate for candidate, _ in case.contest.entries if candidate.name == EASED]
    if not easing:
        return None
    own, slides, *signatures = inn.of_terms(
        [
            (found.term, found.values),
            (easing[0].term, easing[0].unit(0)),
            *((candidate.term, candidate.unit(1)) for candidate in easing),
        ]
    )
    known = sliding.machine_columns
    columns = range(len(known), len(known) + 1 + len(signatures))
    rows = [*known, slides, *signatures]
    evidence = Evidence(inn.white + own, rows, case.weight, range(len(known)), case.evidence.block)
    if sliding.damping_sd > 0.0:
        given, fitted = (system.modes[0].damping_ratio for system in (case.system, sliding.system))
        evidence.expect(1, given - fitted, DAMPING_KNOWN * given)
    right, normal, size = within(evidence, columns)
    right, normal = right * size, normal * np.outer(size, size)
    # Of friction with a stiction so many times as large: what it explains per unit, squared, and how much of it.
    explained = right[0] + np.outer(right[1:], STICTIONS)
    square = normal[0, 0] + 2.0 * np.outer(normal[0, 1:], STICTIONS) + np.outer(np.diag(normal)[1:], STICTIONS**2)
    friction = np.maximum(explained / square, 0.0)
    gains = 0.5 * explained * friction
    if logsumexp(gains) - math.log(gains.size) <= 0.5 * right[0] ** 2 / normal[0, 0]:
        return None
    i, j = np.unravel_index(np.argmax(gains), gains.shape)
    likeliest = easing[i].with_coefficients(friction[i, j] * np.array([1.0, STICTIONS[j]]))
    return AppliedTerm(easing[i].term, likeliest)
