"""An effect that acts in a part of the recording only, or only above an amplitude."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.case import SURE, Case, Local
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.name import PRICE_NATS

Vector = NDArray[np.float64]

LESS_NATS = 10.0  # by which an effect in a part of the recording has to beat everything that acts all along
ENDS_S = 0.05  # to which the ends of a stretch are told
LEAST_BLOCKS = 2  # of the training blocks
ABOVE = np.geomspace(0.8, 2.4, 7)  # amplitudes tried, over the rms displacement; then as many about the best
_FINER = np.linspace(-1.0, 1.0, 9)[1:-1]  # steps of those


def acting(
    inn: Innovations, between_s: tuple[float, float] | None = None, above: float | None = None
) -> NDArray[np.bool_]:
    """Where along `inn.motion` a force acts that does so in a stretch, or above an amplitude, only; shape (2, n)."""
    acts = np.ones_like(inn.motion.x, dtype=bool)
    if between_s is not None:
        at = np.arange(acts.shape[1]) * inn.observer.step_s
        acts &= (at >= between_s[0]) & (at < between_s[1])
    if above is not None:
        acts &= np.hypot(inn.motion.x, inn.motion.v / inn.observer.omega) > above
    return acts


def find_local(case: Case) -> Local | None:
    """An effect in a part of the recording: found on the training blocks, confirmed by the held-out ones in it.

    It has to beat everything that acts all along.
    """
    evidence = case.evidence
    half = evidence.only(case.training)
    best: tuple[float, Candidate, int, slice] | None = None
    for candidate, columns in case.contest.entries:
        if len(columns) != 1:
            continue
        first, last, gain = stretch(half, columns[0])
        gain -= PRICE_NATS * (3 + candidate.shapes)
        if best is not None and gain <= best[0]:
            continue
        if _regressed(evidence, columns, slice(2 * first, 2 * last), case.training)[0] >= candidate.lower[0]:
            best = gain, candidate, columns[0], slice(2 * first, 2 * last)
    if best is None or best[0] < _all_along(case) + LESS_NATS:
        return None
    gain, candidate, column, where = best
    coefficient, _, _ = _regressed(evidence, [column], where, case.training)
    check, sd, held = _regressed(evidence, [column], where, ~case.training)
    p = float(stats.norm.sf(check / sd * np.sign(coefficient)))
    if p > SURE:
        return None
    # All samples together tell the ends better.
    begin, end = _ends(case, column, where)
    inside = np.zeros(case.recorded.samples.size)
    rate_hz = case.recorded.rate_hz
    inside[round(begin * rate_hz) : round(end * rate_hz)] = 1.0
    return Local(candidate, case.matrix[column] * inside, gain, held, p, between_s=(begin, end))


def find_above(case: Case) -> Local | None:
    """An effect above an amplitude only, found and confirmed in the same way.

    The best shape of each name is tried at several amplitudes, the best of all then at some more around it.
    """
    entries = case.contest.best([], case.training).values()
    tried = [candidate for _, candidate, columns, _ in entries if len(columns) == 1]
    sd_x, _ = scales(case.innovations.motion)
    best = _best_above(case, tried, [float(a * sd_x) for a in ABOVE])
    if best is None:
        return None
    ratio = float(ABOVE[1] / ABOVE[0])
    best = (
        _best_above(case, [best.candidate], [(best.above or 0.0) * ratio ** float(finer) for finer in _FINER]) or best
    )
    if best.p_value > SURE or best.gain_nats < _all_along(case) + LESS_NATS:
        return None
    return best


def _best_above(case: Case, tried: Sequence[Candidate], amplitudes: Sequence[float]) -> Local | None:
    """Of candidates at each of the amplitudes, the one that gains most on the training blocks."""
    inn = case.innovations
    forces = inn.forces([(candidate.term, candidate.unit(candidate.linear[0])) for candidate in tried])
    signatures = inn.respond(forces, [acting(inn, above=above) for above in amplitudes])
    nuisance = case.matrix[case.evidence.nuisance]
    k = len(nuisance)
    evidence = Evidence(inn.white, [*nuisance, *signatures], case.weight, range(k), case.evidence.block)
    best: Local | None = None
    for i, (candidate, above) in enumerate(product(tried, amplitudes)):
        fit = evidence.regress([k + i], case.training)
        gain = fit.gain - PRICE_NATS * (2 + candidate.shapes)
        if fit.coefficients[0] < candidate.lower[0] or (best is not None and gain <= best.gain_nats):
            continue
        check = evidence.regress([k + i], ~case.training)
        p = float(stats.norm.sf(check.coefficients[0] / check.sd[0] * np.sign(fit.coefficients[0])))
        best = Local(candidate, signatures[i], gain, check.gain, p, above=above)
    return best


def _all_along(case: Case) -> float:
    """What names explain on the training blocks if they act all along, however many it takes; 0 for none."""
    entries = case.contest.best([], case.training).values()
    alone = max((entry[0] for entry in entries), default=0.0)
    columns = [column for scored in case.named for column in scored.columns]
    shapes = sum(scored.candidate.shapes for scored in case.named)
    together = case.evidence.regress(columns, case.training).gain - PRICE_NATS * (len(columns) + shapes)
    return max(alone, together, 0.0)


def _regressed(
    evidence: Evidence, columns: Sequence[int], where: slice, blocks: NDArray[np.bool_]
) -> tuple[float, float, float]:
    """Coefficient, its standard deviation, and gain, on some blocks of a stretch."""
    inside = np.zeros(evidence.blocks, dtype=bool)
    inside[where] = True
    fit = evidence.regress(columns, inside & blocks)
    return float(fit.coefficients[0]), float(fit.sd[0]), fit.gain


def stretch(evidence: Evidence, column: int) -> tuple[int, int, float]:
    """Run of blocks in which one column gains most: the first, one past the last, and the gain in nats."""
    index = [column + 1, *(i + 1 for i in evidence.nuisance)]
    products = evidence.products[:, column + 1][:, [0, *index]]
    first, last = np.triu_indices(evidence.blocks + 1, LEAST_BLOCKS)
    gain = _gains(evidence, products, first, last)
    best = int(np.argmax(gain))
    return int(first[best]), int(last[best]), float(gain[best])


def _ends(case: Case, column: int, where: slice) -> tuple[float, float]:
    """Ends of a stretch in seconds, each within a block of a first idea in blocks."""
    evidence, rate_hz = case.evidence, case.recorded.rate_hz
    n = case.recorded.samples.size
    edges = np.round(np.arange(0.0, n / rate_hz, ENDS_S) * rate_hz).astype(np.int64)
    weighted = case.matrix[column] * case.weight**2
    rows = [case.innovations.white, *case.matrix[[column, *evidence.nuisance]]]
    products = np.column_stack([np.add.reduceat(weighted * row, edges[edges < n]) for row in rows])
    per_block = max(1, round(case.block_s / ENDS_S))
    around = np.arange(-2 * per_block, 2 * per_block + 1)  # a training block and the held-out one beside it
    begins, ends = np.meshgrid(where.start * per_block + around, where.stop * per_block + around, indexing="ij")
    allowed = (begins >= 0) & (ends <= len(products)) & (ends - begins >= per_block)
    first, last = begins[allowed], ends[allowed]
    best = int(np.argmax(_gains(evidence, products, first, last)))
    return float(first[best] * ENDS_S), float(min(last[best] * ENDS_S, n / rate_hz))


def _gains(
    evidence: Evidence, products: NDArray[np.float64], first: NDArray[np.int64], last: NDArray[np.int64]
) -> Vector:
    """Gain of one column confined to each of several runs of pieces.

    Parameters
    ----------
    evidence : Evidence
        What the nuisance columns explain.
    products : ndarray of float64, shape (pieces, 2 + k)
        Of the column with errors, itself and the nuisance columns, in each piece.
    first, last : ndarray of int64, shape (runs,)
        First piece, and one past the last.
    """
    total = evidence.over(evidence.everything)
    nuisance = [i + 1 for i in evidence.nuisance]
    normal = total[np.ix_(nuisance, nuisance)]
    inverse = np.linalg.inv(normal + 1e-9 * np.diag(np.diag(normal)))
    sums = np.concatenate([np.zeros((1, products.shape[1])), np.cumsum(products, axis=0)])
    part = sums[last] - sums[first]
    score = part[:, 0] - part[:, 2:] @ (inverse @ total[nuisance, 0])
    weight = part[:, 1] - np.einsum("ri,ij,rj->r", part[:, 2:], inverse, part[:, 2:])
    return np.asarray(0.5 * score**2 / np.maximum(weight, 1e-300))
