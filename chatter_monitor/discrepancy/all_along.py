"""What acts all along, once everything is fitted through the nonlinear filter: names, and laws not quite theirs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from chatter_monitor.discrepancy.augment import DAMPING_KNOWN, Augmented, Start, augment, calibrated, fullest
from chatter_monitor.discrepancy.basis import scales
from chatter_monitor.discrepancy.case import Case
from chatter_monitor.discrepancy.columns import beside
from chatter_monitor.discrepancy.diagnosis import offset_beside
from chatter_monitor.discrepancy.eased import EASED, SLIDING, eased
from chatter_monitor.discrepancy.findings import IN_WORDS, of_term
from chatter_monitor.discrepancy.in_part.amplitude import named_above
from chatter_monitor.discrepancy.in_part.models import begins_above
from chatter_monitor.discrepancy.innovations import Diverged, Innovations
from chatter_monitor.discrepancy.itself import Itself
from chatter_monitor.discrepancy.linear import MECHANICAL, Omission
from chatter_monitor.discrepancy.name import MOST_TERMS, PRICE_NATS, SURE_NATS, Scored
from chatter_monitor.discrepancy.observer import Linear
from chatter_monitor.discrepancy.report import Finding
from chatter_monitor.discrepancy.unnamed import POWERS_AND_SIDES, Rest, Unnamed, out_of_range
from chatter_monitor.physics.parts import AppliedTerm

# What a force of no name has to explain beside what is named, and as a share of that: no law is exact, nor is a filter;
# a regression, which takes the motion from the base model, much less so.
REST_NATS = 6.0
REST_SHARE, FITTED_REST_SHARE = 0.2, 0.02
OWN_SHARE = 0.1  # of what is named: a filter leaves no more of its own model
SECOND_SHARE = 0.8  # of what a second name explains that another power or symmetry of the first may explain, too
DAMPED_SD = 1.96  # by which the machine's damping beside a law may differ from the model file's: two-sided 95 %
_DAMPINGS_TRIED, _LEAST_SD, _LEAST_DAMPING = 200, 1e-3, 1e-5
RIVALS = 3  # fitted fully
RIVAL_NATS, RIVAL_SHARE = 6.0, 0.05  # how near to the leader's evidence, for that


@dataclass(frozen=True, slots=True, eq=False)
class Named:
    """What acts all along.

    Attributes
    ----------
    omissions : list of Omission
        Of the linear machine, that stay beside the names.
    findings : list of Finding
        Terms.
    strange : list of str
        What is there and is none of them, in words.
    augmented : Augmented, optional
        Model with the terms, or with the omissions.
    left : Unnamed, optional
        What the terms leave, if there are any.
    partly : bool
        The one term begins at an amplitude, in the model, too.
    """

    omissions: list[Omission]
    findings: list[Finding] = field(default_factory=list)
    strange: list[str] = field(default_factory=list)
    augmented: Augmented | None = None
    left: Unnamed | None = None
    partly: bool = False


def name_all_along(case: Case) -> Named:
    """Fit the leaders fully, and those that explain more beside the first; `case.named` is what is left of them."""
    found = _fullest(case, _leaders(case)) if case.named else None
    if found is None or _taken_back(found[1]):
        strange = ["a force with which the model runs away from it"] if case.named and found is None else []
        case.named = []
        return Named(case.base.omissions, [], strange, _with_omissions(case))
    first, augmented, omissions = found
    itself = Itself(case, augmented)
    left, further = _beside(case, first, augmented, itself)
    # What explains more beside the first may explain all of it: the regression takes the motion from a machine without
    # it, and may have ranked it too low.
    ranked = _ranked(case, further)
    alone = _fullest(case, ranked) if ranked else None
    if alone is not None and alone[1].cost < augmented.cost:
        first, augmented, omissions = alone
        itself = Itself(case, augmented)
        left, further = _beside(case, first, augmented, itself)
    # A law that is a little another explains it as simply as two that are right.
    if further and max(left.variations.values()) < SECOND_SHARE * further[0].fit.gain:
        terms = [*augmented.system.terms[-1:], *(_applied(case, scored) for scored in further)]
        try:
            augmented = augment(case, terms, augmented.innovations.linear)
            itself = Itself(case, augmented)
            case.named += further
            left = _left(case, augmented, itself)
        except Diverged:
            pass  # then the first has to do
    case.threshold = named_above(case)
    begun = begins_above(case, augmented)
    both = zip(case.named, (begun or augmented).parameters, strict=True)
    findings = [of_term(scored, parameters) for scored, parameters in both]
    strange = [] if begins(case, left) else _other_laws(case, augmented, left, itself)
    case.offset_p = offset_beside(case, augmented.innovations, augmented.system.terms[-len(case.named) :])
    return Named(omissions, findings, strange, begun or augmented, left, begun is not None)


def _taken_back(augmented: Augmented) -> bool:
    """Whether the full fit leaves nothing of a force that the regression named: all its coefficients are 0."""
    [applied] = augmented.system.terms[-len(augmented.parameters) :]
    linear = {parameter.name for parameter in applied.term.parameters if parameter.linear}
    return all(value == 0.0 for name, (value, _) in augmented.parameters[0].items() if name in linear)


def _with_omissions(case: Case) -> Augmented | None:
    """The model with what the linear machine lacks; None if that is nothing."""
    inn, omissions = case.innovations, case.base.omissions
    if not omissions:
        return None
    return Augmented(calibrated(case, inn.linear, inn.terms), inn, [], [], [], omissions[0].gain_nats)


def _beside(case: Case, first: Scored, augmented: Augmented, itself: Itself) -> tuple[Unnamed, list[Scored]]:
    """What the first term leaves, and names for that; they may stand for no more than what it leaves fitted fully."""
    case.named = [first]
    left = _left(case, augmented, itself)
    return left, _further(case, first, augmented) if max(left.smooth.values()) > REST_NATS else []


def _leaders(case: Case) -> list[Scored]:
    """The first name of the regression, and those near it."""
    leader = case.named[0]
    least = leader.evidence_nats - max(RIVAL_NATS, RIVAL_SHARE * leader.evidence_nats)
    if leader.candidate.name in case.contest.seen:
        least = max(least, SURE_NATS)  # others would have to be confirmed
    near = (each for each in case.ranking if each.evidence_nats > least and each.candidate != leader.candidate)
    rivals = [leader, *near]
    names = [scored.candidate.name for scored in rivals]
    if EASED in names and SLIDING in names[: names.index(EASED)]:  # which has to be there before it can ease
        del rivals[names.index(EASED)]
    return rivals[:RIVALS]


def _ranked(case: Case, found: Sequence[Scored]) -> list[Scored]:
    """Names that were found beside another, as they stand in the regression before any is named."""
    names = {scored.candidate.name for scored in found}
    return [scored for scored in case.ranking if scored.candidate.name in names]


def _fullest(case: Case, rivals: Sequence[Scored]) -> tuple[Scored, Augmented, list[Omission]] | None:
    """Whichever of some names explains most once everything is fitted through the nonlinear filter.

    A nonlinear force makes a spectrum that looks like a linear omission: what the base was found to lack stays
    only if they explain less without it. None if all of them run away from the recording.
    """
    rivals = list(rivals)
    inn, base = case.innovations, case.base
    machine = [omission for omission in base.omissions if omission.name in MECHANICAL]
    price = PRICE_NATS * sum(len(omission.parameters) for omission in machine)
    starts = [Start((_applied(case, scored),), _retuned(inn.linear, scored), inn.terms, price) for scored in rivals]
    for scored, start in list(zip(rivals, starts, strict=True)):
        others = [
            *(replace(start, found=(each,)) for each in _without_width(start.found[0])),
            *(replace(start, linear=linear) for linear in _at_stated_speed(case, scored)),
        ]
        rivals += [scored] * len(others)
        starts += others
    with_machine = len(rivals)
    if machine:
        delayed = base.linear.delay_s is not None  # where the tool leaves the cut, it has this delay
        alone = [scored for scored in rivals if not (delayed and scored.candidate.term.chip_thickness)]
        # Where a mode more fits the spectrum, the first of the two is nearer to the machine than one mode for both.
        first = replace(inn.linear, modes=inn.linear.modes[:1])
        of_one = len(inn.linear.modes) == 1
        single = [_retuned(base.machine, s) if of_one else first for s in alone]
        starts += [Start((_applied(case, s),), lin, case.system.terms) for s, lin in zip(alone, single, strict=True)]
        rivals += alone
    try:
        number, augmented = fullest(case, starts)
    except Diverged:
        return None
    return *_eased(case, rivals[number], augmented), machine if number < with_machine else []


def _eased(case: Case, first: Scored, augmented: Augmented) -> tuple[Scored, Augmented]:
    """The model with friction that eases in place of friction that does not, if that is likelier."""
    law = eased(case, augmented) if first.candidate.name == SLIDING else None
    if law is None:
        return first, augmented
    start = Start((law,), augmented.innovations.linear, augmented.system.terms[:-1])
    try:
        return next(each for each in case.ranking if each.candidate.name == EASED), fullest(case, [start])[1]
    except (Diverged, StopIteration):
        return first, augmented


def _further(case: Case, first: Scored, augmented: Augmented) -> list[Scored]:
    """What explains more beside the first term, with its columns before the base model."""
    contest = beside(case, augmented.innovations, augmented.columns, first.candidate)
    further, _ = contest.run(most=MOST_TERMS - 1)
    columns = dict(case.contest.entries)
    found = []
    for scored in further:
        there = dict(zip(scored.all_columns, columns[scored.candidate], strict=True))
        kept = [there[column] for column in scored.columns]
        found.append(replace(scored, all_columns=columns[scored.candidate], columns=kept))
    return found


def _retuned(linear: Linear, scored: Scored) -> Linear:
    """Without the stiffness and the damping that the base has in place of a term."""
    if len(linear.modes) > 1 or scored.candidate.term.chip_thickness:
        return linear
    spring, damper = scored.fit.all_coefficients[:2]
    return linear.beside(float(spring), float(damper))


def _applied(case: Case, scored: Scored) -> AppliedTerm:
    fitted = dict(zip(scored.columns, scored.fit.coefficients, strict=True))
    coefficients = [float(fitted.get(column, 0.0)) for column in scored.all_columns]
    if scored.candidate.term.chip_thickness and case.base.linear.delay_s is not None:  # that delay is the same force
        coefficients = [case.base.linear.regeneration]
    return AppliedTerm(scored.candidate.term, scored.candidate.with_coefficients(coefficients))


def _without_width(applied: AppliedTerm) -> list[AppliedTerm]:
    """The term without a shape that it may go without, as friction may without a width; none if it has none."""
    spare = {p.name: 0.0 for p in applied.term.parameters if not p.linear and p.default == 0.0}
    if all(applied.parameters.get(name, 0.0) == 0.0 for name in spare):
        return []
    return [AppliedTerm(applied.term, {**applied.parameters, **spare})]


def _at_stated_speed(case: Case, scored: Scored) -> list[Linear]:
    """The linear machine with the delay that the model file states, where the tool leaves the cut.

    There the comb in the spectrum, from which the base has its delay, is bent, and the delay is not fitted here.
    """
    spindle, linear = case.system.spindle, case.innovations.linear
    if not scored.candidate.term.chip_thickness or linear.spindle in (None, spindle):
        return []
    return [replace(linear, spindle=spindle)]


def _left(case: Case, augmented: Augmented, itself: Itself) -> Unnamed:
    """What the augmented model leaves, and does not leave of itself."""
    rest = Rest(case, augmented.innovations, augmented.columns, augmented.system.terms[-len(case.named) :])
    left = rest.examined()
    most = max(*left.smooth.values(), *left.variations.values())
    if REST_NATS < most < OWN_SHARE * augmented.gain_nats:
        return rest.examined(itself.rests)
    return left


def begins(case: Case, left: Unnamed) -> bool:
    """Whether it is best explained by an amplitude above which it acts, that the named law leaves something."""
    others = [*left.smooth.values(), *left.variations.values()]
    return case.threshold is not None and case.threshold.gain_nats > max(others)


def _other_laws(case: Case, augmented: Augmented, left: Unnamed, itself: Itself) -> list[str]:
    """Names whose law is not quite that of the recording, in words."""
    strange: list[str] = []
    for scored, applied, parameters in zip(
        case.named, augmented.system.terms[-len(case.named) :], augmented.parameters, strict=True
    ):
        name = scored.candidate.name
        variations = {how: left.variations[name, how] for how in POWERS_AND_SIDES}
        clearest = max(variations, key=lambda how: variations[how])
        if variations[clearest] > max(REST_NATS, FITTED_REST_SHARE * scored.evidence_nats):
            strange.append(f"a force like {IN_WORDS[name]}, but one that {POWERS_AND_SIDES[clearest]}")
        elif (shape := out_of_range(augmented.innovations, applied, parameters)) is not None:
            strange.append(f"a force like {IN_WORDS[name]}, but with a {shape.replace('_', ' ')} beyond that of one")
        elif _dissipates(augmented.innovations, applied) and (ratio := _damped_otherwise(case, augmented, itself)):
            strange.append(
                f"a force like {IN_WORDS[name]}, but beside it the machine is damped {ratio:.2g} times as much as in "
                "the model, which may be a part of the force"
            )
    return strange


def _dissipates(inn: Innovations, applied: AppliedTerm) -> bool:
    """Whether a force depends on the velocity, or on an internal state."""
    term, (sd_x, sd_v) = applied.term, scales(inn.motion)
    felt = {term.force(sd_x, v, 0.0, 0.0, sd_v / sd_x, 0.0, applied.values) for v in (0.0, sd_v)}
    return term.memory_rate is not None or len(felt) > 1


def _damped_otherwise(case: Case, augmented: Augmented, itself: Itself) -> float | None:
    """Damping of the machine beside the named forces over that of the model file, if that is another.

    A force that grows with the root of the velocity is dry friction and a damper but for a few per cent. Whether
    what dissipates is one force or two, only what is known of the machine tells.
    """
    known, fitted = case.system.modes[0].damping_ratio, augmented.system.modes[0].damping_ratio
    if _apart(known, fitted, augmented.damping_sd) > DAMPED_SD:
        fitted = max(fitted - itself.damping_bias, _LEAST_DAMPING)
    return fitted / known if _apart(known, fitted, augmented.damping_sd) > DAMPED_SD else None


def _apart(known: float, fitted: float, fitted_sd: float) -> float:
    """Standard deviations by which a damping ratio and that of a model file differ.

    The ratio is looked for that agrees best with both. A fit knows the ratio to so much, a model file its logarithm.
    """
    tried = np.geomspace(known, fitted, _DAMPINGS_TRIED)
    by_fit = (tried - fitted) / max(fitted_sd, _LEAST_SD * fitted)
    return math.sqrt(float(np.min((np.log(tried / known) / DAMPING_KNOWN) ** 2 + by_fit**2)))
