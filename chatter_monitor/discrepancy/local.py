"""An effect that acts in a part of the recording only."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import stats

from chatter_monitor.discrepancy.case import SURE, Case, Local
from chatter_monitor.discrepancy.name import LESS_NATS, PRICE_NATS, stretch


def find_local(case: Case) -> Local | None:
    """An effect in a part of the recording: found on the training blocks, confirmed by the held-out ones in it.

    It has to beat everything that acts all along.
    """
    evidence = case.evidence
    halves = [evidence.only(case.training), evidence.only(~case.training)]
    best: Local | None = None
    for candidate, columns in case.contest.entries:
        if len(columns) != 1:
            continue
        first, last, gain, _ = stretch(halves[0], columns[0])
        gain -= PRICE_NATS * (3 + candidate.shapes)
        if best is not None and gain <= best.gain_nats:
            continue
        inside = np.zeros(evidence.blocks, dtype=bool)
        inside[2 * first : 2 * last] = True
        fit = evidence.regress(columns, inside & case.training)
        if fit.coefficients[0] < candidate.lower[0]:
            continue
        check = evidence.regress(columns, inside & ~case.training)
        p = float(stats.norm.sf(check.coefficients[0] / check.sd[0] * np.sign(fit.coefficients[0])))
        best = Local(candidate, columns, (2 * first, 2 * last), gain, check.gain, p)
    all_along = max((entry[0] for entry in case.contest.best([], case.training).values()), default=0.0)
    if best is None or best.p_value > SURE or best.gain_nats < max(all_along, 0.0) + LESS_NATS:
        return None
    begin, end, _, _ = stretch(evidence, best.columns[0])  # all blocks together tell the ends better
    return replace(best, blocks=(begin, end)) if begin < best.blocks[1] and end > best.blocks[0] else best
