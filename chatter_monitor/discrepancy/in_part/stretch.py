"""An effect that acts in a stretch of the recording only.

First where: the training blocks say in which stretch any candidate gains most; a spring and a damper that change there
are candidates, too. Then what: all candidates, confined to that part, against each other, as
those that act all along are (`name.Contest`). Several that explain it about equally are not told apart.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain, combinations

import numpy as np
from numpy.typing import NDArray

from chatter_monitor.discrepancy.candidates import Candidate
from chatter_monitor.discrepancy.case import Case, Local
from chatter_monitor.discrepancy.evidence import Evidence
from chatter_monitor.discrepancy.innovations import Innovations
from chatter_monitor.discrepancy.name import HELD_OUT_P, LEAST_HELD_OUT_NATS, PRICE_NATS, Contest, Scored
from chatter_monitor.discrepancy.report import Alternative

Vector = NDArray[np.float64]
Entry = tuple[Candidate, list[int]]

LESS_NATS = 10.0  # by which an effect in a part of the recording has to beat everything that acts all along
# By which one name has to beat the next: odds of 20 to 1; and by which share of what it explains a change of the
# machine there, because the regression takes the motion from the machine of the whole recording.
APART_NATS, CHANGED_SHARE = 3.0, 0.05
ENDS_S = 0.05  # to which the ends of a stretch are told
LEAST_BLOCKS = 2  # of the training blocks
_SEEN = 1e-6  # share of a column's products with itself that has to lie in a stretch
RETUNED = "parameter_drift"  # of a spring and a damper that change there


def acting(
    inn: Innovations, between_s: tuple[float, float] | None = None, above: float | None = None
) -> NDArray[np.bool_]:
    """Where along `inn.motion` a force acts that does so in a stretch, or above an amplitude, only; shape (2, n)."""
    acts = np.ones_like(inn.motion.x, dtype=bool)
    if between_s is not None:
        at = np.arange(acts.shape[1]) * inn.observer.step_s
        acts &= (at >= between_s[0]) & (at < between_s[1])
    if above is not None:
        acts &= swing(inn) > above
    return acts


def swing(inn: Innovations) -> NDArray[np.float64]:
    """Amplitude of the motion, shape (2, n)."""
    return np.asarray(np.hypot(inn.motion.x, inn.motion.v / inn.observer.omega))


def find_local(case: Case) -> Local | None:
    """An effect in a stretch of the recording; None if nothing there beats what acts all along."""
    half = case.evidence.only(case.training)
    entries = [(candidate.shapes, columns, candidate.lower) for candidate, columns in case.contest.entries]
    entries.append((0, case.columns["retuning"][:2], (-np.inf, -np.inf)))
    best = 0.0
    where: tuple[list[int], slice] | None = None
    for shapes, columns, lower in entries:
        for chosen, floor in _subsets(columns, lower):
            first, last, gain = stretch(half, chosen, floor)
            gain -= PRICE_NATS * (2 + len(chosen) + shapes)
            if gain > best:
                best, where = gain, (chosen, slice(2 * first, 2 * last))
    if where is None:
        return None
    # All samples together tell the ends better.
    between_s = _ends(case, *where)
    inside = acting(case.innovations, between_s)[0]
    confined = {c: case.matrix[[c]] * inside for c in chain.from_iterable(columns for _, columns, _ in entries)}
    return told(case, case.contest.entries, confined, case.columns["retuning"][:2], 2, between_s=between_s)


def told(
    case: Case,
    entries: Sequence[Entry],
    confined: Mapping[int, NDArray[np.float64]],
    retuning: Sequence[int],
    ends: int,
    between_s: tuple[float, float] | None = None,
    of_several: float = 1.0,
) -> Local | None:
    """What explains a part of the recording best, on all blocks; None if the held-out blocks do not confirm it.

    Parameters
    ----------
    entries : sequence of (Candidate, list of int)
        Candidates with the columns of their coefficients.
    confined : mapping of int to ndarray of float64, shape (1, n)
        What is left of each of these columns in that part.
    retuning : sequence of int
        Columns of a spring and a damper that may change there.
    ends : int
        How many numbers say where.
    between_s : (float, float), optional
        The stretch, if it is one.
    of_several : float
        Share of what several names that act all along explain together, that one name here has to explain.
    """
    nuisance, numbers = case.matrix[case.evidence.nuisance], list(confined)
    k = len(nuisance)
    columns = [*nuisance, *(signature for number in numbers for signature in confined[number])]
    evidence = Evidence(case.innovations.white, columns, case.weight, range(k), case.evidence.block)
    at = {number: k + i for i, number in enumerate(numbers)}
    contest = Contest(evidence, [(candidate, [at[c] for c in of_it]) for candidate, of_it in entries])
    ranking, changed = _ranked(contest, []), 0.0
    beside, fit = evidence.bounded([at[c] for c in retuning], (-np.inf, -np.inf), PRICE_NATS)
    names = {scored.candidate.name: scored.evidence_nats for scored in ranking}
    if beside:
        changed = fit.gain - PRICE_NATS * len(beside)
    if not ranking or changed < ranking[0].evidence_nats - _from_change(ranking[0].evidence_nats):
        beside = []
    elif (further := _ranked(contest, beside)) and _confirmed(further[0].held_out_nats, further[0].p_value):
        # More than the machine changes there: then a name has to say what.
        ranking, names = further, {each.candidate.name: changed + each.evidence_nats for each in further}
    else:
        names[RETUNED] = changed
    order = sorted(names, key=lambda name: -names[name])
    if not order or names[order[0]] - PRICE_NATS * ends < _all_along(case, of_several) + LESS_NATS:
        return None
    units: tuple[int, ...] = ()
    leading = beside
    if order[0] != RETUNED:
        leader = ranking[0]
        leading = [*leader.columns, *(beside if RETUNED not in names else [])]
        both = zip(leader.all_columns, leader.candidate.linear, strict=True)
        units = tuple(i for column, i in both if column in leader.columns)
    trained, base = evidence.regress(leading, case.training), evidence.regress([], case.training)
    held = evidence.gain_on(trained, leading, base, ~case.training)
    p = evidence.p_value(leading, ~case.training)
    if not _confirmed(held, p):
        return None
    leads = names[order[0]]
    near = {name: _from_change(leads) if RETUNED in (name, order[0]) else APART_NATS for name in order}
    as_likely = [Alternative(name, float(names[name])) for name in order if names[name] > leads - near[name]]
    candidate = ranking[0].candidate if units else None
    which = tuple(i for i, column in enumerate(retuning) if at[column] in leading)
    return Local(candidate, units, which, [columns[i] for i in leading], as_likely, held, p, between_s)


def _from_change(evidence_nats: float) -> float:
    """Distance between a name and a change of the machine below which neither is told from the other."""
    return max(APART_NATS, CHANGED_SHARE * evidence_nats)


def _ranked(contest: Contest, given: Sequence[int]) -> list[Scored]:
    """The best shape of every name beside columns that are given, most evidence first."""
    entries = contest.best(given, contest.evidence.everything).values()
    return sorted((contest.score(each, given) for each in entries if each[3]), key=lambda each: -each.evidence_nats)


def _confirmed(held_out_nats: float, p_value: float) -> bool:
    """As of a name that acts all along."""
    return held_out_nats >= LEAST_HELD_OUT_NATS and p_value <= HELD_OUT_P


def _all_along(case: Case, of_several: float) -> float:
    """What a name explains that acts all along, a share of what several do, or a machine that drifts; 0 for none."""
    evidence = case.evidence
    everything = evidence.everything
    alone = max((entry[0] for entry in case.contest.best([], everything).values()), default=0.0)
    columns = [column for scored in case.named for column in scored.columns]
    shapes = sum(scored.candidate.shapes for scored in case.named)
    together = of_several * (evidence.regress(columns).gain - PRICE_NATS * (len(columns) + shapes))
    waves = case.columns["time"]
    springs, dampers = waves[: len(waves) // 2], waves[len(waves) // 2 :]
    drifting = [
        evidence.regress(some[:most]).gain - PRICE_NATS * len(some[:most])
        for some in (springs, dampers, [wave for both in zip(springs, dampers, strict=True) for wave in both])
        for most in range(1, len(some) + 1)
    ]
    return max(alone, together, *drifting, 0.0)


def _subsets(columns: Sequence[int], lower: Sequence[float]) -> Iterator[tuple[list[int], Vector]]:
    """Columns with their lower bounds: each alone, and all together."""
    for size in range(1, len(columns) + 1):
        for chosen in combinations(range(len(columns)), size):
            yield [columns[i] for i in chosen], np.array([lower[i] for i in chosen])


def stretch(evidence: Evidence, columns: Sequence[int], lower: Vector) -> tuple[int, int, float]:
    """Run of blocks in which columns gain most: the first, one past the last, and the gain in nats."""
    rows = [0, *(i + 1 for i in (*columns, *evidence.nuisance))]
    products = evidence.products[:, [c + 1 for c in columns]][:, :, rows]
    first, last = np.triu_indices(evidence.blocks + 1, LEAST_BLOCKS)
    gain = _gains(evidence, products, first, last, lower)
    best = int(np.argmax(gain))
    return int(first[best]), int(last[best]), float(gain[best])


def _ends(case: Case, columns: Sequence[int], where: slice) -> tuple[float, float]:
    """Ends of a stretch in seconds, each within a block of a first idea in blocks."""
    evidence, rate_hz = case.evidence, case.recorded.rate_hz
    n = case.recorded.samples.size
    edges = np.round(np.arange(0.0, n / rate_hz, ENDS_S) * rate_hz).astype(np.int64)
    weight2 = case.weight**2
    rows = [case.innovations.white, *case.matrix[[*columns, *evidence.nuisance]]]
    products = np.stack(
        [
            np.column_stack([np.add.reduceat(case.matrix[c] * weight2 * row, edges[edges < n]) for row in rows])
            for c in columns
        ],
        axis=1,
    )
    per_block = max(1, round(case.block_s / ENDS_S))
    around = np.arange(-2 * per_block, 2 * per_block + 1)  # a training block and the held-out one beside it
    begins, ends = np.meshgrid(where.start * per_block + around, where.stop * per_block + around, indexing="ij")
    allowed = (begins >= 0) & (ends <= len(products)) & (ends - begins >= per_block)
    first, last = begins[allowed], ends[allowed]
    best = int(np.argmax(_gains(evidence, products, first, last)))
    return float(first[best] * ENDS_S), float(min(last[best] * ENDS_S, n / rate_hz))


def _gains(
    evidence: Evidence,
    products: NDArray[np.float64],
    first: NDArray[np.int64],
    last: NDArray[np.int64],
    lower: Vector | float = -np.inf,
) -> Vector:
    """Gain of columns confined to each of several runs of pieces; none where a coefficient is below its bound.

    Parameters
    ----------
    evidence : Evidence
        What the nuisance columns explain.
    products : ndarray of float64, shape (pieces, c, 1 + c + k)
        Of c columns with errors, themselves and k nuisance columns, in each piece.
    first, last : ndarray of int64, shape (runs,)
        First piece, and one past the last.
    lower : ndarray of float64, shape (c,)
        Bounds of the coefficients.
    """
    total = evidence.over(evidence.everything)
    nuisance = [i + 1 for i in evidence.nuisance]
    normal = total[np.ix_(nuisance, nuisance)]
    inverse = np.linalg.inv(normal + 1e-9 * np.diag(np.diag(normal)))
    c = products.shape[1]
    sums = np.concatenate([np.zeros((1, *products.shape[1:])), np.cumsum(products, axis=0)])
    part = sums[last] - sums[first]
    beside = part[:, :, 1 + c :]
    score = part[:, :, 0] - beside @ (inverse @ total[nuisance, 0])
    weight = part[:, :, 1 : 1 + c] - beside @ inverse @ beside.transpose(0, 2, 1)
    # A force that hardly acts there, or that the nuisance imitates, has nothing to gain.
    whole = np.diagonal(sums[-1][:, 1 : 1 + c])
    size = np.diagonal(weight, axis1=1, axis2=2)
    acts = np.all(size > _SEEN * whole, axis=1)
    weight[~acts] = np.eye(c)
    coefficients = np.linalg.solve(weight, score[:, :, None])[:, :, 0]
    gain = 0.5 * np.einsum("rc,rc->r", score, coefficients)
    return np.where(acts & np.all(coefficients >= lower, axis=1), gain, 0.0)
